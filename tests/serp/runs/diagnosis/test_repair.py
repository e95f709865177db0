"""The repaired file."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.learned.regression_data import predictions
from serp.runs.diagnosis.findings import EffectTerm, MissingEffect, ParameterFinding, decimal
from serp.runs.diagnosis.repair import Repaired, repair
from tests.serp.model.learned.rolls import DT, balance, cartpole, from_text
from tests.serp.model.learned.test_parameter_fit import CARTS
from tests.serp.runs.diagnosis.made_up import (
    found,
    kept,
    logic,
    parameter,
    repaired_by,
    written,
)
from tests.serp.runs.diagnosis.test_analysis import FLEET, ROBOTS

NAMES = ("cartpole", "cartpole-empty", "cartpole-no-velocity", "cartpole-reversed")


@pytest.mark.parametrize("name", NAMES)
def test_a_real_run_repairs_its_file(name: str) -> None:
    experience, _ = balance(cartpole().source.text, 3, 400, noise=0.1)
    domain = cartpole(name)
    repaired = repaired_by(domain, experience, DT)
    assert repaired.changes
    new = written(domain, repaired)
    assert logic(new) == logic(domain)
    assert kept(domain.source.text, repaired.text)
    predicted = predictions(new.model.replace(dt=DT), experience.states, experience.actions)
    off, change = (
        np.sqrt(((experience.next_states - p) ** 2).mean(0)) for p in (predicted, experience.states)
    )
    # What is left is what a straight line cannot say of a swinging pole.
    assert (off <= 0.005 * change).all()


def test_a_number_whose_sign_is_uncertain_becomes_0() -> None:
    domain = from_text("""(define (domain d) (:functions (f))
      (:action a :parameters () :precondition (and) :effect (increase (f) 1)))""")
    text = repair(domain, found(parameter(domain.model, 0, -1e-9, error=1e-9))).text
    assert "; 1 as written; observed" in text and "(increase (f) 0)" in text


SIZES = st.floats(1e-6, 1e6).flatmap(lambda x: st.sampled_from([x, -x]))


@given(SIZES, st.floats(0.0, 0.3))
def test_a_number_is_a_plain_decimal_within_its_error(value: float, share: float) -> None:
    error = share * abs(value)
    text = decimal(value, error)
    assert re.fullmatch(r"-?\d+(\.\d+)?", text)
    assert abs(float(text) - value) <= max(error, 5.001e-4 * abs(value))
    assert (float(text) < 0) == (value < 0)
    assert len(text.strip("-0.").replace(".", "")) <= max(4, math.log10(abs(value)) + 1.001)


@pytest.mark.parametrize(
    ("value", "error", "number"),
    [
        (0.2, 0.01, "0.20"),
        (-0.105, 0.0096, "-0.105"),
        (15.7734, 0.0005, "15.77"),
        (1.0, 1e-9, "1"),
        (1234.0, 20.0, "1230"),
        (0.0, 0.1, "0"),
    ],
)
def test_a_number_ends_where_it_is_uncertain(value: float, error: float, number: str) -> None:
    assert decimal(value, error) == number


def test_terms_are_binary_products() -> None:
    assert EffectTerm(-0.5, 0.01, ("a",)).size == "(* 0.50 (a))"
    assert EffectTerm(1.0, 1e-6, ("b ?x", "c")).size == "(* (b ?x) (c))"
    assert EffectTerm(2.0, 0.1, ()).size == "2.0"


def test_an_assignment_takes_in_what_was_missing() -> None:
    domain = from_text(CARTS)
    terms = EffectTerm(0.9996, 1e-5, ("v ?c",)), EffectTerm(-0.3, 0.01, ("heat",))
    text = repair(domain, found(MissingEffect("stop", None, "v ?c", terms, 50, 1.0))).text
    assert "(assign (v ?c) (+ (- 0.125 (* 0.30 (heat))) (* 0.9996 (v ?c))))" in text


SHAPES = {
    "an and": ":effect (and (increase (f) 1.0))",
    "an and over lines": ":effect (and\n      (increase (f) 1.0)\n      (increase (f) 2.0))",
    "comments behind": ":effect (and\n      (increase (f) 1.0) ; one\n      ; two (\n    )",
    "an empty and": ":effect (and)",
    "nothing": ":effect ()",
    "one effect": ":effect (increase (f) 1.0)",
    "no effect": "",
    "a comment behind the brackets": ":effect (and\n      (increase (f) 1.0))  ; one",
    "a comment in front": ":effect (and  ; none\n      (increase (f) 1.0))  ; one",
    "a comment behind one line": ":effect (and (increase (f) 1.0))  ; one",
    "a comment behind one effect": ":effect (increase (f) 1.0)  ; one",
    "a comment behind nothing": ":effect (and)  ; none",
}


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())
def test_effects_fit_into_actions_of_any_shape(shape: str, newline: str) -> None:
    text = f"""; before
(define (domain d)
  (:predicates (unsafe))
  (:functions (f) (g))
  (:action a
    :parameters ()
    :precondition (and (< (f) 9.0))
    {shape}
  )
)
; after
""".replace("\n", newline)
    domain = from_text(text)
    findings = found(
        MissingEffect("a", None, "g", (EffectTerm(0.5, 0.01, ("f",)),), 10, 1.0),
        MissingEffect("a", None, "f", (EffectTerm(-2.0, 0.01, ()),), 10, 1.0),
        MissingEffect("", None, "f", (EffectTerm(3.0, 0.01, ("g",)),), 10, 1.0),
    )
    repaired = repair(domain, findings)
    new = written(domain, repaired).model
    old = domain.model
    state = {"f": 4.0, "g": 2.0}
    after, before = (
        model.values(model.replace(dt=0.1).step(model.state(state), "a").state)
        for model in (new, old)
    )
    assert after["g"] == pytest.approx(4.0)
    assert after["f"] == pytest.approx(before["f"] - 2.0 + 0.1 * 3.0 * 4.0)
    assert (newline == "\r\n") == ("\r\n" in repaired.text)
    assert repaired.text.count("\n") == repaired.text.count(newline)
    assert all(len(line) <= 100 for line in repaired.text.splitlines())
    assert kept(text, repaired.text)
    for line in repaired.text.splitlines():  # each comment is where it was
        if "; one" in line:
            assert "(increase (f) 1.0)" in line


@pytest.mark.parametrize(("schema", "last"), [("process", "slow"), ("event", "fast")])
def test_a_process_follows_the_last_one(schema: str, last: str) -> None:
    domain = from_text(f"""(define (domain d)
  (:functions (f))
  (:action a :parameters () :precondition (and) :effect (and))  ; fast
  (:{schema} p :parameters () :precondition (and) :effect (and))  ; slow
)""")
    effect = MissingEffect("", None, "f", (EffectTerm(2.0, 0.01, ()),), 10, 1.0)
    assert f"; {last}\n\n  (:process f-changes\n" in repair(domain, found(effect)).text


def test_processes_have_new_names_and_typed_parameters() -> None:
    text = FLEET.replace("(:action rest", "(:action wind-changes")
    world = MissingEffect("", None, "wind", (EffectTerm(1.0, 0.01, ()),), 10, 1.0)
    typed = replace(world, fluent="way ?r")
    repaired = repair(from_text(text, ROBOTS), found(world, world, typed))
    assert "(:process way-changes\n    :parameters (?r - robot)" in repaired.text
    assert "(:process wind-changes-2" in repaired.text
    assert "(:process wind-changes-3" in repaired.text


def test_a_problem_file_is_not_touched(tmp_path: Path) -> None:
    problem = ROBOTS.replace("(:init)", "(:init (= (gain) 2.0))")
    text = FLEET.replace("(wind)", "(wind) (gain)").replace("(way ?r) 0.5", "(way ?r) (gain)")
    domain = from_text(text, problem)
    assert domain.problem_source is not None
    gain = next(p for p in domain.model.parameters if p.role == "initial")
    finding = ParameterFinding(gain, "drive", "way", 2.0, 3.0, 0.01, 100, 1.0)
    (told,) = repair(domain, found(finding)).in_problem
    assert repair(domain, found(finding)) == Repaired(text, (), (told,))
    assert told.startswith("world-problem.pddl, line ") and "2.0 as written; observed 3" in told
