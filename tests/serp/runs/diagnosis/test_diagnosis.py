"""What a diagnosis says is true, and what a repair writes is what the diagnosis says."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.model.domain import Domain
from serp.model.learned.regression_data import predicted_steps
from serp.model.transition_model import TransitionModel
from serp.runs.diagnosis.accuracy import WELL
from serp.runs.diagnosis.analysis import findings
from serp.runs.diagnosis.diagnosis import Diagnosis, Recorded, make_diagnosis
from serp.runs.diagnosis.findings import Findings
from serp.runs.diagnosis.plots import picture
from serp.runs.diagnosis.repair import Repaired, repair
from tests.serp.model.learned.rolls import DOMAINS, from_text, on_ice
from tests.serp.runs.diagnosis.made_up import (
    chances,
    found,
    missing,
    parameter,
    predictions_with,
    recorded,
    states_of,
    taken,
    written,
)

ROVER = """(define (domain rover)
  (:requirements :strips :numeric-fluents :time)
  (:predicates (lit) (terminal))
  (:functions (x) (heat) (wind) (reward))
  (:action go :parameters () :precondition (and)
    :effect (and (increase (x) 0.5) (increase (heat) 0.2) (lit)))
  (:action rest :parameters () :precondition (and)
    :effect (and (decrease (x) 0.4) (decrease (heat) 0.3) (not (lit))))
  (:event arrived :parameters () :precondition (and (> (x) 2.5))
    :effect (and (increase (reward) 4.0) (terminal)))
  (:event hot :parameters () :precondition (and (> (heat) 1.0))
    :effect (and (decrease (reward) 1.0))))
"""
STILL = """(define (domain still) (:functions (x))
  (:action rest :parameters () :precondition (and) :effect (and)))
"""
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


def seen_in(world: World, seed: int = 0) -> Recorded:
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


def diagnosed(seen: Recorded) -> Diagnosis:
    return make_diagnosis(seen, findings(seen.model, seen.experience))


def repaired(diagnosis: Diagnosis) -> Repaired:
    return repair(diagnosis.recorded.domain, diagnosis.worthwhile)


def errors_of(domain: Domain, seen: Recorded) -> dict[str, float]:
    """The error of each quantity as a share of its change, by the definition alone."""
    experience = seen.experience
    said, written_so = (
        predicted_steps(model, experience.states, experience.actions)
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
def test_whatever_is_wrong_the_diagnosis_says_so_and_the_repair_writes_it(world: World) -> None:
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


@pytest.mark.parametrize(
    ("world", "line", "says"),
    [
        (World(number=0.8), 6, "write 0.8 instead of 0.5 for `(x)`; observed 0.8"),
        (World(effect=0.4), 5, "add `(increase (wind) 0.4)`; observed"),
        (World(broken=True), 5, "instead nothing changes in 100"),
        (World(endless=True), 10, "`(terminal)`, predicted in"),
        (World(prize=1.0), 10, "`(increase (reward) 4.0)`, predicted in"),
        (World(sudden=0.05), None, ", and no line of the file says so"),
    ],
)
def test_each_error_is_told_in_the_words_of_the_file(
    world: World, line: int | None, says: str
) -> None:
    diagnosis = diagnosed(seen_in(world))
    (remark,) = (r for r in diagnosis.remarks if says in r.text and r.line == line)
    assert remark.share > 0.3


def test_what_follows_from_a_wrong_number_is_not_told_again() -> None:
    """Ends come late because the way is longer: with the right number they come in time."""
    diagnosis = diagnosed(seen_in(World(number=0.2)))
    assert [remark.finding.symbols for remark in diagnosis.remarks] == [{"x"}]
    assert {"reward", "terminal"} <= {q.name for q in diagnosis.quantities if q.error > WELL}
    assert not diagnosis.unexplained


def test_chance_explains_what_it_makes_uncertain() -> None:
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    diagnosis = diagnosed(taken(domain, on_ice(domain, 0)))
    rows = {q.name: q for q in diagnosis.quantities}
    assert rows["row"].error_left > 0.5 and rows["row"].unexplained <= WELL
    assert rows["column"].error_left > 0.5 and rows["column"].unexplained <= WELL


# With findings made up --------------------------------------------------------------------------


def made_up(model: TransitionModel, truth: Findings, told: Findings) -> Diagnosis:
    """The diagnosis that tells something of a world of which something else may be true."""
    states, actions = states_of(model, 400)
    after = predictions_with(model, truth, states, actions)
    return make_diagnosis(recorded(model, states, actions, after), told)


def test_what_is_uncertain_or_hardly_matters_is_told_apart(model: TransitionModel) -> None:
    truth = found(parameter(model, 0, 2.5))
    told = found(
        parameter(model, 0, 2.5, cost=0.4),
        parameter(model, 3, 0.53, cost=0.4),  # not by four standard errors
        missing(model, "battery ?r", {(): 0.3}, cost=1e-5),
        chances(model, "light", ({"lit": 1.0}, 0.5, True), cost=0.0),
    )
    unsure = missing(model, "warmth", {(): 0.05, ("place ?r",): 0.3}, cost=0.5)
    told = replace(told, missing=(*told.missing, unsure))
    diagnosis = made_up(model, truth, told)
    assert diagnosis.worthwhile.parameters == told.parameters[:1]
    (kept,) = diagnosis.worthwhile.missing
    assert [term.fluents for term in kept.terms] == [("place ?r",)]
    assert diagnosis.worthwhile.stochastic == told.stochastic
    assert len(diagnosis.remarks) == 3


def test_where_nothing_can_be_compared_nothing_is_said(model: TransitionModel) -> None:
    states, actions = states_of(model, 60)
    states[:, 0] = np.nan
    diagnosis = diagnosed(recorded(model, states, actions, states))
    assert diagnosis.sample.left_out == {"a value that is not a finite number": 60}
    assert diagnosis.verdict == "None of these steps can be compared with the file."
    assert not (diagnosis.remarks or diagnosis.unexplained)
    still, rest = from_text(STILL), np.zeros((60, 1))
    still_diagnosis = diagnosed(recorded(still.model, rest, np.zeros(60, int), rest, domain=still))
    assert still_diagnosis.verdict.startswith("Nothing changed in these steps, as predicted")


def test_a_picture_has_equal_bytes_for_equal_diagnoses() -> None:
    diagnosis = diagnosed(seen_in(World(number=0.8, broken=True)))
    assert picture(diagnosis, "svg") == picture(diagnosis, "svg")
    still = from_text(STILL)
    rest = recorded(still.model, np.zeros((9, 1)), np.zeros(9, int), np.zeros((9, 1)), domain=still)
    assert picture(diagnosed(rest), "png").startswith(b"\x89PNG")


# The file patched with findings -----------------------------------------------------------------

GRID = """(define (domain grid)
  (:requirements :conditional-effects :numeric-fluents)
  (:functions (row) (column))
  (:action down :parameters () :precondition (and)
    :effect (and (when (< (row) 3) (increase (row) 1))))
  (:action left :parameters () :precondition (and)
    :effect (and (when (> (column) 0) (decrease (column) 1)))))
"""


def test_outcomes_count_as_their_mean(model: TransitionModel) -> None:
    states, actions = states_of(model, 60)
    findings = found(
        chances(model, "drive", ({"place ?r": 1.5}, 0.5, True), ({"place ?r": -1.0}, 0.25, False))
    )
    truth = predicted_steps(model, states, actions)[:, :-2]
    names = [action.name for action in model.actions]
    columns = {fluent.name: fluent.index for fluent in model.fluents}
    for robot in ("r1", "r2"):
        rows = actions == names.index(f"drive {robot}")
        truth[rows, columns[f"place {robot}"]] = states[rows, columns[f"place {robot}"]] + 0.5
    np.testing.assert_allclose(predictions_with(model, findings, states, actions), truth)


def test_an_outcome_like_another_action_stops_at_the_walls_of_that_action() -> None:
    model = from_text(GRID).model
    rng = np.random.default_rng(0)
    states = rng.integers(0, 4, size=(200, 2)).astype(np.float64)
    finding = chances(model, "down", ({"row": 1.0}, 0.5, True), ({"column": -1.0}, 0.5, False))
    own, other = finding.outcomes
    findings = found(replace(finding, outcomes=(own, replace(other, like="left"))))
    actions = np.zeros(len(states), np.int64)
    truth = (model.step(states, 0).state + model.step(states, 1).state) / 2
    np.testing.assert_allclose(predictions_with(model, findings, states, actions), truth)
