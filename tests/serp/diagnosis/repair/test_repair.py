"""The repaired file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from serp.diagnosis.findings import (
    EffectTerm,
    MissingEffect,
    ObservedOutcome,
    ParameterFinding,
    StochasticEffect,
)
from serp.diagnosis.repair.repair import Repaired, repair
from serp.pddl.portability import outside_portable_subset, refused_by_unified_planning
from serp.sysid.parameter_dependencies import parameter_dependencies
from serp.sysid.regression_data import predictions
from tests.serp.diagnosis.repairing import (
    comments,
    kept,
    literal,
    logic,
    of,
    repaired_by,
    written,
)
from tests.serp.diagnosis.test_estimation import FLEET, ROBOTS, TRUE_FLEET
from tests.serp.sysid.rolls import DOMAINS, DT, balance, cartpole, from_text, imagined
from tests.serp.sysid.test_parameter_fit import CARTS, carts_states

NAMES = ("cartpole", "cartpole-empty", "cartpole-no-velocity", "cartpole-no-gravity",
         "cartpole-cart-only", "cartpole-reversed")  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_a_real_run_repairs_its_file(name: str) -> None:
    experience, _ = balance(cartpole().source.text, 3, 400, noise=0.1)
    domain = cartpole(name)
    repaired = repaired_by(domain, experience, DT)
    assert repaired.repairs
    new = written(domain, repaired)
    assert not outside_portable_subset(new.source)
    assert refused_by_unified_planning(new.source, None) is None
    assert logic(new) == logic(domain)
    rest = iter(comments(repaired.text))
    assert all(any(line == c for c in rest) for line in comments(domain.source.text))
    predicted = predictions(new.model.replace(dt=DT), experience.states, experience.actions)
    off, change = (
        np.sqrt(((experience.next_states - p) ** 2).mean(0)) for p in (predicted, experience.states)
    )
    # What is left is what a straight line cannot say of a swinging pole.
    assert (off <= 0.005 * change).all()


@pytest.mark.parametrize("name", ["cartpole-empty", "cartpole-no-velocity", "cartpole-reversed"])
def test_a_planner_balances_from_the_repaired_file(name: str) -> None:
    seen, _ = balance(cartpole().source.text, 3, 400, noise=0.1)
    domain = cartpole(name)
    text = repaired_by(domain, seen, DT).text
    for seed in (10, 11):
        assert balance(text, seed, 500)[1] == 0


def test_ignorant_falls_are_enough_for_an_empty_file() -> None:
    domain = cartpole("cartpole-empty")
    seen, falls = balance(domain.source.text, 0, 500, noise=1.0)
    assert falls > 5
    text = repaired_by(domain, seen, DT).text
    assert balance(text, 10, 500)[1] == 0


def test_a_repaired_file_is_repaired() -> None:
    seen, _ = balance(cartpole().source.text, 3, 400, noise=0.1)
    domain = cartpole("cartpole-empty")
    once = repaired_by(domain, seen, DT)
    again = from_text(once.text)
    other, _ = balance(cartpole().source.text, 4, 400, noise=0.1)
    twice = repaired_by(again, other, DT)
    assert len(twice.repairs) <= 3


@pytest.mark.parametrize("seed", range(4))
def test_a_right_file_is_left_alone(seed: int) -> None:
    domain = from_text(CARTS)
    model = domain.model.replace(dt=0.1)
    rng = np.random.default_rng(seed)
    experience = imagined(model, carts_states(300, rng), rng, 0.02)
    repaired = repaired_by(domain, experience, 0.1)
    assert (repaired.text, repaired.repairs) == (CARTS, ())


def test_numbers_change_where_they_stand_and_nowhere_else() -> None:
    domain = from_text(CARTS)
    repaired = repair(domain, of(literal(domain, 0, 0.7312, 0.02)))
    (change,) = repaired.repairs
    new = CARTS.replace("(increase (v ?c) 0.5)", "(increase (v ?c) 0.73)")
    lines = [line for line in repaired.text.splitlines(True) if "as written" not in line]
    assert "".join(lines) == new
    assert "; 0.5 as written; observed 0.73 +/- 0.02 in 412 steps\n" in repaired.text
    assert change.before == "(increase (v ?c) 0.5)"
    assert change.after == "(increase (v ?c) 0.73)"
    assert change.schema == "push" and change.line == CARTS[: CARTS.index("0.5)")].count("\n") + 1


def test_signs_turn_the_word_around() -> None:
    domain = from_text(CARTS)
    for position, estimate, text in (
        (0, -0.2, "(decrease (v ?c) 0.20)"),
        (1, -0.3, "(increase (v ?c) 0.30)"),
        (2, -0.25, "(decrease (heat) (* 0.25 (* 3.0 (v ?c))))"),
        (3, -2.0, "(decrease (heat) (* 0.1 (* 2.00 (v ?c))))"),
        (4, -1.0, "(assign (v ?c) -1.00)"),
        (5, -0.5, "(decrease (x ?c) (* #t (* 0.50 (v ?c))))"),
        (6, -0.5, "(increase (heat) (* #t 0.50))"),
    ):
        repaired = repair(domain, of(literal(domain, position, estimate)))
        assert text in repaired.text
        assert kept(CARTS, repaired.text)
    both = repair(domain, of(literal(domain, 2, -0.25), literal(domain, 3, -2.0)))
    assert "(increase (heat) (* 0.25 (* 2.00 (v ?c))))" in both.text


def test_what_may_be_nothing_is_written_as_nothing() -> None:
    domain = from_text(CARTS)
    nothing = repair(domain, of(literal(domain, 0, -0.02, 0.01)))
    assert "(increase (v ?c) 0)" in nothing.text and "observed -0.02 +/- 0.01" in nothing.text


def test_an_assignment_takes_in_what_was_missing() -> None:
    domain = from_text(CARTS)

    def with_terms(*terms: EffectTerm) -> str:
        missing = MissingEffect("stop", None, "v ?c", terms, False, 50, 1.0)
        return repair(domain, of(missing=(missing,))).text

    own = EffectTerm(0.9996, 1e-5, ("v ?c",))
    assert "(increase (v ?c) 0.125)" in with_terms(own)
    assert "(increase (v ?c) 0.125)" in with_terms(own, EffectTerm(-0.3, 0.01, ("heat",)))
    assert "(decrease (v ?c) (* 0.30 (heat)))" in with_terms(own, EffectTerm(-0.3, 0.01, ("heat",)))
    half = with_terms(EffectTerm(0.5, 0.001, ("v ?c",)))
    assert "(assign (v ?c) (+ 0.125 (* 0.500 (v ?c))))" in half
    falling = repair(
        domain,
        of(
            literal(domain, 4, -0.5),
            missing=(MissingEffect("stop", None, "v ?c", (own,), False, 50, 1.0),),
        ),
    )
    assert "(decrease (v ?c) 0.50)" in falling.text


def test_processes_of_typed_fluents_have_parameters() -> None:
    domain = from_text(FLEET, ROBOTS)
    truth = from_text(TRUE_FLEET, ROBOTS)
    rng = np.random.default_rng(0)
    model = domain.model.replace(dt=0.5)
    states = rng.uniform(-1.0, 1.0, size=(600, len(model.fluents)))
    seen = imagined(truth.model.replace(dt=0.5), states, rng, noise=0.001)
    repaired = repaired_by(domain, seen, 0.5)
    new = written(domain, repaired)
    assert ":parameters (?r - robot)" in repaired.text[repaired.text.index("(:process") :]
    predicted = predictions(new.model.replace(dt=0.5), seen.states, seen.actions)
    assert np.abs(predicted - seen.next_states).max() < 0.02


def test_names_of_processes_are_new() -> None:
    text = FLEET.replace("(:action rest", "(:action wind-changes")
    world = MissingEffect("", None, "wind", (EffectTerm(1.0, 0.01, ()),), True, 10, 1.0)
    repaired = repair(from_text(text, ROBOTS), of(missing=(world, world)))
    assert "(:process wind-changes-2" in repaired.text
    assert "(:process wind-changes-3" in repaired.text


def test_chance_is_told_in_comments() -> None:
    domain = from_text((DOMAINS / "cliff.pddl").read_text(encoding="utf-8"))
    outcomes = (
        ObservedOutcome((("row", -1.0),), 0.34, 0.02, True),
        ObservedOutcome((("column", 1.0),), 0.33, 0.02, False),
        ObservedOutcome((), 0.33, 0.02, False),
    )
    place = domain.model.actions[0].place
    repaired = repair(domain, of(stochastic=(StochasticEffect("up", place, outcomes, 500, 0.1),)))
    lines = repaired.text.splitlines(True)
    added = [line for line in lines if line not in domain.source.text.splitlines(True)]
    assert all(line.strip().startswith(";") for line in added)
    assert "".join(line for line in lines if line not in added) == domain.source.text
    assert "  ;   34 +/- 2 %: (row) -1, as written\n" in added


def test_soccer_keeps_its_rules() -> None:
    domain = from_text((DOMAINS / "soccer.pddl").read_text(encoding="utf-8"))
    model = domain.model.replace(dt=0.4)
    theta = model.theta.copy()
    changed = [i.parameter.index for i in parameter_dependencies(model.ground)]
    theta[changed] *= 2.0
    rng = np.random.default_rng(0)
    states = rng.uniform(0.0, 3.0, size=(800, len(model.fluents)))
    numeric = np.array([fluent.numeric for fluent in model.fluents])
    states = np.where(numeric, states, states > 1.5)
    seen = imagined(model.replace(theta=theta), states, rng, noise=0.005)
    repaired = repaired_by(domain, seen, 0.4)
    assert logic(written(domain, repaired)) == logic(domain)
    assert kept(domain.source.text, repaired.text)
    right = {p.place.line: p.value for p in domain.model.parameters if p.index in changed}
    found = [p.value for p in written(domain, repaired).model.parameters if p.index in changed]
    assert found == pytest.approx([2.0 * value for value in right.values()], rel=0.03)
    assert len(repaired.repairs) == len(changed)


def test_a_problem_file_is_not_touched(tmp_path: Path) -> None:
    problem = ROBOTS.replace("(:init)", "(:init (= (gain) 2.0))")
    text = FLEET.replace("(wind)", "(wind) (gain)").replace("(way ?r) 0.5", "(way ?r) (gain)")
    domain = from_text(text, problem)
    assert domain.problem_source is not None
    gain = next(p for p in domain.model.parameters if p.role == "initial")
    finding = ParameterFinding(gain, "drive", "way", 2.0, 3.0, 0.01, 100, 1.0)
    (told,) = repair(domain, of(finding)).open
    assert repair(domain, of(finding)) == Repaired(text, (), (told,))
    assert told.startswith("world-problem.pddl, line ") and "2.0 as written; observed 3" in told
