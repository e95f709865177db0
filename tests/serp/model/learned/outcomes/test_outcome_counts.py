"""Counted outcomes: what chance does to predicates and whole numbers."""

import numpy as np
import pytest

from serp import _core
from serp.agent.causes import causes_of
from serp.errors import RunError
from serp.model.flags import UNSAFE, risk_of
from tests.serp.model.learned import worlds
from tests.serp.model.learned.worlds import GRID, adapted
from tests.worlds import text

DRIFT = """
(define (domain drift) (:functions {functions})
  (:action wait :parameters () :effect (and {effects})))
"""


def slip(adaptation, count, wet_slips=False):
    """Go right: a third of the times, or when it is wet, the robot goes down instead."""
    random = np.random.default_rng(0)
    for _ in range(count):
        wet = float(random.integers(2))
        state = np.array([wet, float(random.integers(3)), float(random.integers(3))])
        slips = bool(wet) if wet_slips else random.random() < 1 / 3
        change = np.array([0.0, 1.0, 0.0]) if slips else np.array([0.0, 0.0, 1.0])
        adaptation.observe(state, 0, state + change, False)


def prediction(adaptation, *state, action=0):
    out, flags = adaptation.model.transition(list(state), action)
    return np.array(out[:-1]), out[-1], flags


def shared(adaptation):
    """The tables that are in use."""
    groups = adapted(adaptation).shared.values()
    return [group.outcomes for group in groups if group.outcomes is not None]


def test_the_likeliest_outcome_follows_and_the_reward_is_expected():
    adaptation = worlds.adaptation(GRID, seed=3)
    slip(adaptation, 600)
    # Where nobody has ever been: what is known elsewhere holds here.
    state, reward, _ = prediction(adaptation, 0.0, 0.0, 40.0)
    assert state.tolist() == [0.0, 0.0, 41.0]
    assert reward == 5.0
    _, reward, flags = prediction(adaptation, 0.0, 2.0, 10.0)
    assert reward == pytest.approx(5.0 - 9.0 / 3, abs=0.6)
    assert not flags & UNSAFE, "the file as written does not flag it"
    assert risk_of(flags) == pytest.approx(1 / 3, abs=0.07)
    sites, flags = adaptation.model.trace(np.array([0.0, 2.0, 10.0]), 0)
    assert flags & UNSAFE
    assert sites[-1].schema.name == "hole"
    causes = causes_of(adaptation.model, np.array([0.0, 2.0, 10.0]), 0)
    assert "`(unsafe)` (line 12) through event hole" in [cause.quoted for cause in causes]


def test_a_context_that_matters_is_told_apart():
    adaptation = worlds.adaptation(GRID, seed=3)
    slip(adaptation, 300, wet_slips=True)
    wet, _, _ = prediction(adaptation, 1.0, 0.0, 1.0)
    dry, _, flags = prediction(adaptation, 0.0, 2.0, 1.0)
    assert wet.tolist() == [1.0, 1.0, 1.0]
    assert dry.tolist() == [0.0, 2.0, 2.0]
    assert not flags & 2, "who does not slip does not fall"


def test_numbers_that_are_not_whole_or_do_too_many_things_are_left_to_the_residual():
    fractions, many = (worlds.adaptation(GRID, seed=3) for _ in range(2))
    random = np.random.default_rng(2)
    for _ in range(400):
        state = np.array([0.0, *random.normal(size=2)])
        fractions.observe(state, 0, np.add(state, [0.0, 0.25, 0.0]), False)
        state = np.array([0.0, *random.integers(-500, 500, size=2).astype(float)])
        after = np.array([0.0, state[1] + np.round(0.1 * state[2]), state[2]])
        many.observe(state, 0, after, False)
    assert not shared(fractions) and not shared(many)
    state, _, _ = prediction(fractions, 0.0, 0.5, 0.5)
    assert state == pytest.approx([0.0, 0.75, 0.5], abs=0.01)
    state, _, _ = prediction(many, 0.0, 0.0, 100.0)
    assert state == pytest.approx([0.0, 10.0, 100.0], abs=1.0)


def test_a_world_that_changes_is_followed():
    adaptation = worlds.adaptation(GRID, seed=3)
    slip(adaptation, 400)
    random = np.random.default_rng(3)
    for _ in range(3_000):  # the ground has dried
        state = np.array([0.0, float(random.integers(3)), float(random.integers(3))])
        adaptation.observe(state, 0, np.add(state, [0.0, 0.0, 1.0]), False)
    _, _, flags = prediction(adaptation, 0.0, 2.0, 1.0)
    assert not flags & 2


LAKE = text("lake")
"""A lake of five by five cells with a hole; state: frosty, row, column."""
SIZE, HOLE = 5, [2.0, 2.0]
LEFT, RIGHT, UP, DOWN = range(4)


def moved(state, direction):
    by = [(0, -1), (0, 1), (-1, 0), (1, 0)][direction]
    return np.array([state[0], *np.clip(state[1:] + by, 0, SIZE - 1)])


def somewhere(random):
    while True:
        state = random.integers((2, SIZE, SIZE)).astype(float)
        if state[1:].tolist() != HOLE:
            return state


def chances(adaptation, state, action):
    """Return the probability of each next state."""
    found = {}
    for row in adapted(adaptation).core.outcomes(state, action):
        after = tuple(row[: len(state)].tolist())
        found[after] = found.get(after, 0.0) + row[-1]
    assert sum(found.values()) == pytest.approx(1.0)
    return found


def test_who_slips_does_what_the_file_says_of_another_action():
    """Walls and holes of the file hold for slips, too, also where nobody has ever been."""
    adaptation = worlds.adaptation(LAKE, seed=3)
    random = np.random.default_rng(5)
    for _ in range(900):
        state = somewhere(random)
        if state[1] > 2:
            continue
        after = moved(state, int(random.choice([LEFT, UP, DOWN])))
        over = after[1:].tolist() == HOLE
        # What is seen after the end is the next start.
        seen = np.zeros(3) if over else after
        adaptation.observe(state, LEFT, seen, over)
    for row, column in ((0, 0), (4, 0), (4, 3), (1, 2), (2, 3), (4, 4), (0, 4)):
        state = np.array([0.0, row, column])
        expected = {}
        for direction in (LEFT, UP, DOWN):
            there = tuple(moved(state, direction).tolist())
            expected[there] = expected.get(there, 0.0) + 1 / 3
        assert chances(adaptation, state, LEFT) == pytest.approx(expected, abs=0.08)


def test_an_end_that_another_action_explains_may_be_the_first_surprise():
    adaptation, beside = worlds.adaptation(LAKE, seed=3), np.array([0.0, 1.0, 2.0])
    for step in range(30):
        slips = step % 3 == 0
        adaptation.observe(beside, LEFT, moved(beside, DOWN if slips else LEFT), slips)
    assert chances(adaptation, beside, LEFT)[0.0, *HOLE] == pytest.approx(1 / 3, abs=0.08)


def test_a_wall_that_the_file_does_not_mention_is_learned_by_bumping_into_it_twice():
    adaptation = worlds.adaptation(LAKE, seed=3)
    random = np.random.default_rng(6)
    wall = [(row, 1.0) for row in (0.0, 1.0, 3.0)]
    for step in range(300):
        state = somewhere(random)
        blocked = (state[1], state[2]) in wall
        if blocked and step < 200:
            continue
        adaptation.observe(state, RIGHT, state if blocked else moved(state, RIGHT), False)
    states, visits = np.unique(adaptation.experience.states, axis=0, return_counts=True)
    for state in states[visits > 1]:
        after, _, _ = prediction(adaptation, *state, action=RIGHT)
        blocked = (state[1], state[2]) in wall
        assert after.tolist() == (state if blocked else moved(state, RIGHT)).tolist()


def test_damaged_counts_are_refused():
    adaptation = worlds.adaptation(GRID, seed=3)
    slip(adaptation, 100)
    arrays, meta = adaptation.state_dict()
    (prefix,) = [name.removesuffix("codes") for name in arrays if name.endswith(".codes")
                 and "outcome_counts" in name]  # fmt: skip
    codes, totals = arrays[f"{prefix}codes"], arrays[f"{prefix}totals"]
    for name, damaged in (
        ("codes", codes[:-1]),
        ("codes", np.repeat(codes, 2000)),
        ("codes", codes + 0.5),
        ("codes", np.full_like(codes, 2.0**60)),
        ("codes", np.full_like(codes, codes[0])),
        ("totals", np.zeros_like(totals)),
        ("totals", -totals),
        ("schemas", np.zeros(13, np.int64)),
        ("schemas", np.full(2, 2)),
        ("schemas", np.full(2, 0.5)),
        ("changes", np.zeros((13, 1))),
        ("members", np.full(3, 2**20)),
        ("members", np.ones(65, np.int64)),
        ("evidence", np.zeros((len(codes), 4))),
        ("trust", np.zeros(4)),
        ("places", np.array([10**9])),
        ("context", np.array([-1])),
    ):
        with pytest.raises(RunError, match="damaged"):
            worlds.adaptation(GRID).load_state_dict({**arrays, f"{prefix}{name}": damaged}, meta)
    part = meta[prefix.removesuffix(".")]
    for name, number in (("kinds", 13), ("kinds", 0), ("sets", 65), ("rows", 2049), ("rows", -1)):
        with pytest.raises(RunError, match="damaged"):
            damaged = {**meta, prefix.removesuffix("."): {**part, name: number}}
            worlds.adaptation(GRID).load_state_dict(arrays, damaged)
    # All that there is room for, and a number that no array could have.
    columns = arrays[f"{prefix}changes"].shape[1]
    full = {f"{prefix}schemas": np.full(12, -1), f"{prefix}changes": np.zeros((12, columns))}
    with pytest.raises(RunError, match="kinds"):
        damaged = {**meta, prefix.removesuffix("."): {**part, "kinds": 2**45}}
        worlds.adaptation(GRID).load_state_dict({**arrays, **full}, damaged)
    with pytest.raises(RunError):
        worlds.adaptation(GRID).load_state_dict({}, meta)


@pytest.mark.parametrize("fluents", range(1, 6))
def test_probabilities_of_outcomes_add_up_however_many_fluents_vary(fluents):
    """Each of the numbers becomes 1 or 2, with equal chance, and never what the file says."""
    names = [f"(x{k})" for k in range(fluents)]
    effects = " ".join(f"(increase {name} 0)" for name in names)
    model = worlds.from_text(DRIFT.format(functions=" ".join(names), effects=effects)).model
    shared = [_core.GroupParameters(None, 0) for _ in names]
    groups = [([k], [k], part) for k, part in enumerate(shared)]
    core = _core.AdaptedModel(model.written_core(), np.full((1, 1), -1), False, [groups])
    for part in shared:
        table = _core.OutcomeTable(np.zeros(1, np.int64), np.zeros(0, np.int64))
        table.schemas[:3], table.changes[:3, 0] = -1, (0.0, 1.0, 2.0)
        table.members[:2], table.numbers[:2] = (2, 4), 50.0
        table.counts[0, :3], table.totals[0] = (0.0, 50.0, 50.0), 100.0
        table.restore(3, 2, 1)
        part.outcomes = table
    rows = core.outcomes(np.zeros(fluents), 0)
    assert rows[:, -1].sum() == pytest.approx(1.0)
    assert np.isin(rows[:, :fluents], (1.0, 2.0)).all()
    assert len(rows) == min(2**fluents, 8)
