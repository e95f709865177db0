"""The repaired file."""

import functools
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.model.learned.effect_search import may_change
from serp.model.learned.parameter_fit import parameter_dependencies
from serp.model.learned.regression_data import WORLD, LiftedModel, predictions
from serp.runs.diagnosis.findings import (
    EffectTerm,
    MissingEffect,
    ObservedOutcome,
    StochasticEffect,
    decimal,
)
from serp.runs.diagnosis.repair import repair
from tests.serp.model.learned.rolls import DT, balance, cartpole, from_text
from tests.serp.model.learned.test_parameter_fit import CARTS
from tests.serp.runs.diagnosis.made_up import (
    found,
    kept,
    logic,
    parameter,
    predictions_with,
    repaired_by,
    written,
)
from tests.serp.runs.diagnosis.test_analysis import FLEET, ROBOTS
from tests.worlds import DOMAINS

NAMES = ("cartpole", "cartpole-empty", "cartpole-no-velocity", "cartpole-reversed")


@pytest.mark.parametrize("name", NAMES)
def test_a_real_run_repairs_its_file(name):
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


SIZES = st.floats(1e-6, 1e6).flatmap(lambda x: st.sampled_from([x, -x]))


@given(SIZES, st.floats(0.0, 0.3))
def test_a_number_is_a_plain_decimal_within_its_error(value, share):
    error = share * abs(value)
    text = decimal(value, error)
    assert re.fullmatch(r"-?\d+(\.\d+)?", text)
    assert abs(float(text) - value) <= max(error, 5.001e-4 * abs(value))
    assert (float(text) < 0) == (value < 0)
    assert len(text.strip("-0.").replace(".", "")) <= max(4, math.log10(abs(value)) + 1.001)


SHAPES = {
    "an and": ":effect (and (increase (f) 1.0))",
    "comments behind": ":effect (and\n      (increase (f) 1.0) ; one\n      ; two (\n    )",
    "an empty and": ":effect (and)",
    "nothing": ":effect ()",
    "one effect": ":effect (increase (f) 1.0)",
    "no effect": "",
    "a comment in front": ":effect (and  ; none\n      (increase (f) 1.0))  ; one",
    "a comment behind one effect": ":effect (increase (f) 1.0)  ; one",
}


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())
def test_effects_fit_into_actions_of_any_shape(shape, newline):
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


def test_processes_have_new_names_and_typed_parameters():
    text = FLEET.replace("(:action rest", "(:action wind-changes")
    world = MissingEffect("", None, "wind", (EffectTerm(1.0, 0.01, ()),), 10, 1.0)
    typed = replace(world, fluent="way ?r")
    repaired = repair(from_text(text, ROBOTS), found(world, world, typed))
    assert "(:process way-changes\n    :parameters (?r - robot)" in repaired.text
    assert "(:process wind-changes-2" in repaired.text
    assert "(:process wind-changes-3" in repaired.text


SHIPPED = ("cartpole", "cartpole-no-velocity", "landing", "soccer", "cliff")
EXACT = 1e-7  # a standard error that leaves all digits


@functools.cache
def domain_of(name):
    if name == "carts":
        return from_text(CARTS)
    if name == "fleet":
        return from_text(FLEET, ROBOTS)
    return from_text((DOMAINS / f"{name}.pddl").read_text(encoding="utf-8"))


# Two digits, so that nothing is lost where it is written, and none that is about 0 or 1.
NUMBERS = st.integers(-400, 400).map(lambda k: k / 100).filter(lambda x: 0.05 < abs(x - 1) < 3.5)
NUMBERS = NUMBERS.filter(lambda x: abs(x) > 0.05)


@st.composite
def terms_of(draw, scope, numeric, own):
    """Terms in the words of a schema."""
    factors = draw(
        st.lists(
            st.lists(st.sampled_from(numeric), max_size=2).map(sorted).map(tuple),
            min_size=1, max_size=3, unique=True,
        )
    )  # fmt: skip
    terms = []
    for these in factors:
        value = draw(NUMBERS)
        if [f.name for f in these] == [own] and scope.schema != WORLD:
            value = draw(st.sampled_from([1.0, value]))
        terms.append(EffectTerm(value, EXACT, tuple(f.name for f in these)))
    return tuple(terms)


@st.composite
def findings_of(draw, name):
    """Anything that could be found of a file."""
    model = domain_of(name).model
    lifted = LiftedModel(model.ground)
    known = parameter_dependencies(model.ground)
    some = draw(st.sets(st.integers(0, len(known) - 1), max_size=4)) if known else set()
    numbers = [
        parameter(model, k, value, error=EXACT)
        for k in sorted(some)
        if abs((value := draw(NUMBERS)) - known[k].parameter.value) > 0.05
    ]
    numeric = {f.symbol for f in model.fluents if f.numeric}
    scopes = [lifted.schema(s) for s in dict.fromkeys(a.schema for a in model.actions)]
    scopes += [lifted.world(s) for s in sorted(numeric)]
    missing = {}
    for scope in draw(st.lists(st.sampled_from(scopes), max_size=4)):
        words = [f for f in scope.fluents if f.symbol in numeric]
        target = draw(st.sampled_from(scope.targets))
        if scope.schema != WORLD and not may_change(lifted, scope, target):
            continue
        place = next((a.place for a in model.actions if a.schema == scope.schema), None)
        terms = draw(terms_of(scope, words, target.name))
        missing[scope.schema, target.name] = MissingEffect(
            scope.schema, place, target.name, terms, 1234, 1.0
        )
    return found(*numbers, *missing.values())


@pytest.mark.parametrize("name", ["carts", "fleet", *SHIPPED])
@settings(max_examples=6, deadline=None)
@given(data=st.data())
def test_the_file_stays_and_says_what_was_found(name, data):
    domain = domain_of(name)
    findings = data.draw(findings_of(name))
    repaired = repair(domain, findings)
    new = written(domain, repaired)
    assert kept(domain.source.text, repaired.text)
    assert logic(new) == logic(domain)
    assert bool(repaired.changes) == bool(findings.parameters or findings.missing)
    model, again = domain.model.replace(dt=0.1), new.model.replace(dt=0.1)
    rng = np.random.default_rng(0)
    states = rng.uniform(-2.0, 2.0, size=(30, len(model.fluents)))
    states = np.where([f.numeric for f in model.fluents], states, states > 0.0)
    actions = rng.integers(len(model.actions), size=30)
    told = predictions_with(model, findings, states, actions)
    assert predictions(again, states, actions) == pytest.approx(
        told, rel=1e-3, abs=1e-9, nan_ok=True
    )


def test_what_happens_by_chance_becomes_outcomes():
    domain = domain_of("cliff")
    kinds = tuple(
        ObservedOutcome((("row", k),), p, 0.02, k == 1.0) for k, p in ((1.0, 0.4), (2.0, 0.6))
    )
    actions = {a.schema: a for a in domain.model.actions}.values()
    outcomes = [StochasticEffect(a.schema, a.place, kinds, 77, 0.1) for a in actions]
    repaired = repair(domain, found(*outcomes))
    assert len(repaired.changes) == len(outcomes)
    new = written(domain, repaired).model
    row = next(f.index for f in new.fluents if f.name == "row")
    moving = [a for a in new.actions if any(e.target == row for e in a.effects)]
    assert moving and all(
        [o.probability for o in a.outcomes] == [pytest.approx(0.4)] for a in moving
    )
    assert not any(a.outcomes for a in new.actions if a not in moving)


def test_chance_beyond_the_parameters_of_an_action_is_a_comment():
    domain = domain_of("cliff")
    kinds = (ObservedOutcome((("row ?other", 1.0),), 0.6, 0.02, written=False),)
    action = domain.model.actions[0]
    effect = StochasticEffect(action.schema, action.place, kinds, 77, 0.1)
    repaired = repair(domain, found(effect))
    assert repaired.text.count("; Observed: ") == 1
    assert logic(written(domain, repaired)) == logic(domain)
