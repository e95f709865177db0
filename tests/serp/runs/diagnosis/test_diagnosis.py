"""What a diagnosis says is true, and what a repair writes is what the diagnosis says."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import serp
from serp.errors import TaskError
from serp.model.learned.regression_data import predicted_steps
from serp.runs.diagnosis.accuracy import WELL
from serp.runs.diagnosis.analysis import findings
from serp.runs.diagnosis.diagnosis import make_diagnosis, read_recorded
from serp.runs.diagnosis.repair import repair
from serp.runs.run import load_run
from serp.tasks.registry import load_task
from tests.serp.model.learned.rolls import from_text, on_ice
from tests.serp.runs.diagnosis.made_up import (
    found,
    parameter,
    predictions_with,
    recorded,
    states_of,
    taken,
    written,
)
from tests.worlds import DOMAINS, text

ROVER = text("rover")
STEPS = 300


class World(NamedTuple):
    """How the world differs from a file.

    Attributes:
        number: Strength of `go` on x; 0.5 in the file.
        effect: What `go` changes of the wind, of which the file says nothing.
        noise: Standard deviation of what the wind does besides.
        endless: Whether nothing ever ends.
        sudden: Share of the steps that end for no reason.
        prize: Reward for arriving; 4 in the file.
        broken: Whether the lamp never changes.
    """

    number: float = 0.5
    effect: float = 0.0
    noise: float = 0.0
    endless: bool = False
    sudden: float = 0.0
    prize: float = 4.0
    broken: bool = False


def seen_in(world, seed=0):
    """What a run with the file records in such a world."""
    rng = np.random.default_rng(seed)
    truth = ROVER.replace("(x) 0.5)", f"(x) {world.number})").replace("4.0", str(world.prize))
    domain, true = from_text(ROVER), from_text(truth).model
    model = domain.model
    states = rng.uniform(-1.0, 2.6, size=(STEPS, len(model.fluents)))
    names = [fluent.name for fluent in model.fluents]
    states[:, names.index("lit")] = states[:, names.index("lit")] > 0.5
    actions = rng.integers(2, size=STEPS)
    after = predicted_steps(true, states, actions)
    wind = world.effect * (actions == 0) + world.noise * rng.normal(size=STEPS)
    after[:, names.index("wind")] += wind
    if world.broken:
        after[:, names.index("lit")] = states[:, names.index("lit")]
    over = (after[:, -1] != 0.0) & (not world.endless) | (rng.random(STEPS) < world.sudden)
    return recorded(model, states, actions, after[:, :-2], after[:, -2], over, domain)


def diagnosed(seen):
    return make_diagnosis(seen, findings(seen.model, seen.adaptation.experience))


def repaired(diagnosis):
    return repair(diagnosis.recorded.domain, diagnosis.worthwhile)


def errors_of(domain, seen):
    """The error of each quantity as a share of its change, by the definition alone."""
    experience = seen.adaptation.experience
    said, written_so = (
        predicted_steps(model, experience.states, experience.actions, experience.next_states)
        for model in (domain.model, seen.model)
    )
    after = np.column_stack((experience.next_states, experience.rewards, experience.over))
    before = np.column_stack((experience.states, np.zeros((len(after), 2))))
    names = [*(f.name for f in seen.model.fluents), "reward", "terminal"]
    found = {}
    for k, name in enumerate(names):
        off, moved = (float(np.sum((after[:, k] - o[:, k]) ** 2)) for o in (said, before))
        moved = moved or float(np.sum((written_so - before)[:, k] ** 2))
        if moved:
            binary = name in ("lit", "terminal")
            found[name] = off / moved if binary else (off / moved) ** 0.5
    return found


WORLDS = st.builds(
    World,
    number=st.sampled_from([0.5, 0.8, -0.3]),
    effect=st.sampled_from([0.0, 0.4]),
    noise=st.sampled_from([0.0, 0.3]),
    endless=st.booleans(),
    sudden=st.sampled_from([0.0, 0.05]),
    prize=st.sampled_from([4.0, 1.0]),
    broken=st.booleans(),
)


@settings(max_examples=25, deadline=None)
@given(world=WORLDS)
def test_whatever_is_wrong_the_diagnosis_says_so_and_the_repair_writes_it(world):
    seen = seen_in(world)
    diagnosis = diagnosed(seen)
    told = {q.name: q for q in diagnosis.quantities}
    # Every error is what it is by definition, and "well" is said where all are small.
    errors = errors_of(seen.domain, seen)
    assert {name: q.error for name, q in told.items()} == pytest.approx(errors, abs=1e-9)
    well = diagnosis.verdict.startswith("The file predicts well")
    assert well == (max(errors.values()) <= WELL)
    assert world != World() or (well and not diagnosis.remarks and not diagnosis.unexplained)
    # What the repaired file predicts is what the diagnosis promises of what it lists.
    mended = repaired(diagnosis)
    after = errors_of(written(seen.domain, mended), seen)
    chancy = {name for finding in diagnosis.worthwhile.stochastic for name in finding.symbols}
    promised = {name: q.error_left for name, q in told.items() if name not in chancy}
    assert {name: after[name] for name in promised} == pytest.approx(promised, rel=0.02, abs=0.02)
    # What is predicted badly even then is said, in the file as well; and nothing else is.
    bad = {name for name, error in after.items() if error > WELL and name not in chancy}
    shown = {name: f"({name})" for name in after}
    for name, start in shown.items():
        sentence = [line for line in diagnosis.unexplained if line.startswith(start)]
        assert len(sentence) == (name in bad)
    # Each edit is of something that is listed, and all that is listed of this file is written.
    lines = {r.line for r in diagnosis.remarks if r.line is not None}
    assert set(mended.changes) == lines
    assert bool(mended.changes) == bool(lines)
    if not mended.changes:
        assert mended.text == ROVER


def test_what_follows_from_a_wrong_number_is_not_told_again():
    """Ends come late because the way is longer: with the right number they come in time."""
    diagnosis = diagnosed(seen_in(World(number=0.2)))
    assert [remark.finding.symbols for remark in diagnosis.remarks] == [{"x"}]
    assert {"reward", "terminal"} <= {q.name for q in diagnosis.quantities if q.error > WELL}
    assert not diagnosis.unexplained


def test_chance_explains_what_it_makes_uncertain():
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    diagnosis = diagnosed(taken(domain, on_ice(domain, 0)))
    rows = {q.name: q for q in diagnosis.quantities}
    assert rows["row"].error_left > 0.5 and rows["row"].unexplained <= WELL
    assert rows["column"].error_left > 0.5 and rows["column"].unexplained <= WELL


# With findings made up --------------------------------------------------------------------------


def test_what_is_uncertain_is_no_remark(model):
    told = found(parameter(model, 0, 2.5), parameter(model, 3, 0.53))  # by 1.5 standard errors
    states, actions = states_of(model, 400)
    after = predictions_with(model, found(told.parameters[0]), states, actions)
    diagnosis = make_diagnosis(recorded(model, states, actions, after), told)
    assert diagnosis.worthwhile.parameters == told.parameters[:1]
    assert len(diagnosis.remarks) == 1


def test_a_run_of_a_task_that_is_not_installed_can_be_read(tmp_path):
    juggling = dataclasses.replace(load_task("cartpole"), name="juggling")
    serp.plan_and_learn(juggling, env_steps=120, out=tmp_path, quiet=True)
    with pytest.raises(TaskError, match="there is no task `juggling`"):
        load_run(tmp_path)
    recorded = read_recorded(tmp_path)
    seen = recorded.adaptation.experience
    assert recorded.env_steps == len(seen) >= 120
    goes_on = ~seen.over[:-1]
    np.testing.assert_array_equal(seen.states[1:][goes_on], seen.next_states[:-1][goes_on])
