"""The instruction table against the traced step, bit for bit, and forged tables."""

from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp import _core
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.instructions import instruction_table
from serp.model.traced_step import TracedStep
from tests.generated import (
    FULL,
    PLANNABLE,
    Texts,
    examples,
    generate,
    load_texts,
    models_with_states,
    random_states,
)
from tests.worlds import text


def check_same(fast, traced):
    out, flags = fast
    assert flags == traced.flags
    if flags & APPLICABLE:
        assert out.tobytes() == np.array(traced.out).tobytes()
        assert np.isfinite(out).all()


@examples(40)
@given(
    models_with_states(FULL, count=6),
    st.sampled_from((1.0, 0.25, 0.02)),
    st.sampled_from((1.0, 1.5)),
)
def test_the_fast_step_gives_the_bits_of_the_traced_one(drawn, dt, factor):
    generated, states = drawn
    model = generated.model.replace(dt=dt, theta=generated.model.theta * factor)
    core = model.core
    traced, theta = TracedStep(model.ground), model.theta.tolist()
    for k, state in enumerate(states):
        values, other = state.tolist(), states[k - 1]
        for action in range(-1, len(model.actions)):
            fast = core.step(state, action)
            check_same(fast, traced.step(values, action, theta, dt))
            for after in (fast[0][:-1], other) if fast[1] & APPLICABLE else (other,):
                judged = traced.judge(values, action, after.tolist(), theta, dt)
                check_same(core.judge(state, action, after), judged)


@pytest.mark.parametrize("seed", range(30))
def test_a_batch_is_what_its_rows_are(seed):
    random = Random(1000 + seed)
    model = generate(random, FULL if seed % 2 else PLANNABLE).model
    while not model.actions:
        model = generate(random).model
    states = random_states(random, model, 50)
    actions = [random.randrange(len(model.actions)) for _ in states]
    batch = model.step(states, actions)
    for k, (state, action) in enumerate(zip(states, actions, strict=True)):
        single = model.step(state, action)
        for one, whole in zip(single, batch, strict=True):
            assert np.asarray(one).tobytes() == np.asarray(whole[k]).tobytes()
    spread = np.zeros((100, states.shape[1]))[::2]
    spread[:] = states
    for rows in (spread, np.asfortranarray(states)):  # not contiguous
        assert model.step(rows, 0).state.tobytes() == model.step(states, 0).state.tobytes()


def check_lanes(core, states):
    out, flags, *_ = core.steps(states)
    assert flags.shape == (len(states), core.actions)
    for place in np.ndindex(flags.shape):
        row, single = core.step(states[place[0]], place[1])
        assert single == flags[place]
        assert not single & APPLICABLE or row.tobytes() == out[place].tobytes()


@examples(30)
@given(models_with_states(FULL, count=70), st.integers(1, 70), st.sampled_from((1.0, 1.5)))
def test_steps_in_lanes_have_the_bits_of_single_ones(drawn, count, factor):
    """Blocks that are full and not, and states for which conditions differ or are undefined."""
    model = drawn[0].model.replace(theta=drawn[0].model.theta * factor)
    check_lanes(model.core, drawn[1][:count])


def test_more_actions_than_there_are_lanes_for():
    objects = " ".join(f"o{k}" for k in range(17))
    actions = f"""(define (domain many) (:requirements :typing :numeric-fluents) (:types thing)
        (:constants {objects} - thing) (:predicates (held ?a - thing)) (:functions (sum))
        (:action join :parameters (?a - thing ?b - thing) :precondition (not (held ?a))
         :effect (and (held ?b) (increase (sum) (/ 1.0 (sum))))))"""
    model = load_texts(Texts(actions, None)).model
    assert len(model.actions) == 17 * 17
    check_lanes(model.core, random_states(Random(0), model, 9))


def test_a_goal_is_reached_where_a_step_that_changes_nothing_ends():
    checked = 0
    for seed in range(120):
        model = generate(Random(seed), PLANNABLE).model
        if model.ground.goal is None or model.ground.processes or model.ground.events:
            continue
        for state in random_states(Random(seed), model, 10):
            _, flags = model.core.step(state, -1)
            assert model.at_goal(state) == (flags & TERMINAL != 0)
            checked += 1
    assert checked > 40


# Borders ---------------------------------------------------------------------------------------


RICH = text("rich")


@pytest.fixture
def table():
    return instruction_table(load_texts(Texts(RICH, None)).model.ground)


HUGE = 2**32 - 1
REPEAT = 26


def test_every_forged_operand_is_refused(table):
    """Whatever is outside of the frame or the table, in any place that is used."""
    refused = 0
    for place in np.ndindex(table.code.shape):
        written = table.code[place]
        used = _uses(table.code[place[0]])
        for value in (HUGE, 2**31, 10**6):
            table.code[place] = value
            if place[1] == 0 or used[place[1] - 1]:
                with pytest.raises(ValueError, match="the instruction table is damaged"):
                    _core.Program(*table)
                refused += 1
        table.code[place] = written
    assert refused > 300


def _uses(row):
    """Return which operands an instruction has."""
    code = int(row[0])
    if code in (0, 2, 3) or 11 <= code <= 15:
        return True, True, False
    if code in (1, 16):
        return False, False, code == 16
    return True, code not in (17, 18, 25, 26), True


def test_chances_that_do_not_add_up_to_1_are_refused(table):
    rounded = table.chances * (1.0 - 1e-12)
    _core.Program(*table._replace(chances=rounded))
    for factor in (0.5, 1.0 - 1e-3):
        with pytest.raises(ValueError, match="the chances of an action"):
            _core.Program(*table._replace(chances=table.chances * factor))


def test_a_repetition_that_never_ends_is_ended():
    again = 11  # of no fluents and parameters: 7 fixed numbers, the reward, intermediate results
    code = [[3, again, 4, 0], [REPEAT, again, 0, 1], [0, APPLICABLE, 0, 0]]
    program = _core.Program(
        np.array(code, dtype=np.uint32), np.zeros(5, dtype=np.uint32), 0, 0, 8,
        np.arange(2, dtype=np.uint32), np.ones(1),
    )  # fmt: skip
    out, flags = _core.WrittenModel(program, np.zeros(0), 1.0).step(np.zeros(0), 0)
    assert flags == APPLICABLE and out.shape == (1,)


def test_a_forged_table_that_is_accepted_can_be_executed(table):
    """Executing reads and writes inside the frame, whatever the instructions are."""
    random, accepted = Random(0), 0
    for _ in range(3000):
        code = table.code.copy()
        for _ in range(random.randint(1, 4)):
            row, column = random.randrange(len(code)), random.randrange(4)
            code[row, column] = random.randrange(27 if column == 0 else 40)
        entries = table.entries.copy()
        sizes = [*table[2:]]
        if random.random() < 0.2:
            entries[random.randrange(len(entries))] = random.choice((0, 5, len(code), HUGE))
            sizes[random.randrange(3)] += random.randint(-2, 2)
        try:
            program = _core.Program(code, entries, *sizes)
        except ValueError:
            continue
        accepted += 1
        model = _core.WrittenModel(program, np.ones(sizes[1]), 1.0)
        for action in range(-1, 2):
            state = np.array([random.choice((0.0, 1.0, 2.5)) for _ in range(sizes[0])])
            model.step(state, action)
            model.judge(state, action, state)
        model.steps(np.array([state] * 9))
    assert accepted > 100


def test_wrong_arguments_are_refused():
    model = load_texts(Texts(RICH, None)).model
    core = model.core
    state = np.zeros(core.fluents)
    for size in (0, core.fluents - 1, core.fluents + 1):
        for call in (
            lambda: core.step(np.zeros(size), 0),  # noqa: B023
            lambda: core.judge(np.zeros(size), 0, state),  # noqa: B023
            lambda: core.judge(state, 0, np.zeros(size)),  # noqa: B023
            lambda: core.outcomes(np.zeros(size), 0),  # noqa: B023
            lambda: core.uncertainty(np.zeros(size)),  # noqa: B023
            lambda: core.step_batch(np.zeros((2, size)), np.zeros(2, dtype=np.int64)),  # noqa: B023
            lambda: core.steps(np.zeros((2, size))),  # noqa: B023
        ):
            with pytest.raises(ValueError, match="state"):
                call()
    for action in (-2, 2, 2**40):
        with pytest.raises(ValueError, match="action"):
            core.step(state, action)
        with pytest.raises(ValueError, match="action"):
            core.step_batch(np.zeros((1, core.fluents)), np.array([action]))
    with pytest.raises(ValueError, match="shapes"):
        core.step_batch(np.zeros((2, core.fluents)), np.zeros(3, dtype=np.int64))
    program = _core.Program(*instruction_table(model.ground))
    for theta in (model.theta[1:], np.full(len(model.theta), np.nan)):
        with pytest.raises(ValueError, match="theta"):
            _core.WrittenModel(program, theta, 1.0)
    for dt in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(ValueError, match="control period"):
            _core.WrittenModel(program, model.theta, dt)
