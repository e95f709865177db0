"""Whatever is found of whatever file: what the repaired file is, and what it says."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.model.domain import Domain
from serp.model.learned.effect_search import may_change
from serp.model.learned.parameter_fit import parameter_dependencies
from serp.model.learned.regression_data import (
    WORLD,
    LiftedFluent,
    LiftedModel,
    LiftedScope,
    predictions,
)
from serp.runs.diagnosis.findings import (
    EffectTerm,
    Findings,
    MissingEffect,
    ObservedOutcome,
    StochasticEffect,
)
from serp.runs.diagnosis.repair import repair
from tests.serp.model.learned.rolls import DOMAINS, from_text
from tests.serp.model.learned.test_parameter_fit import CARTS
from tests.serp.runs.diagnosis.made_up import (
    found,
    kept,
    logic,
    parameter,
    predictions_with,
    written,
)
from tests.serp.runs.diagnosis.test_analysis import FLEET, ROBOTS

SHIPPED = ("cartpole", "cartpole-no-velocity", "landing", "soccer", "cliff")
EXACT = 1e-7  # a standard error that leaves all digits


@functools.cache
def domain_of(name: str) -> Domain:
    if name == "carts":
        return from_text(CARTS)
    if name == "fleet":
        return from_text(FLEET, ROBOTS)
    return from_text((DOMAINS / f"{name}.pddl").read_text(encoding="utf-8"))


@functools.cache
def lifted_model_of(name: str) -> LiftedModel:
    return LiftedModel(domain_of(name).model.ground)


# Two digits, so that nothing is lost where it is written, and none that is about 0 or 1.
NUMBERS = st.integers(-400, 400).map(lambda k: k / 100).filter(lambda x: 0.05 < abs(x - 1) < 3.5)
NUMBERS = NUMBERS.filter(lambda x: abs(x) > 0.05)


@st.composite
def terms_of(
    draw: st.DrawFn, scope: LiftedScope, numeric: Sequence[LiftedFluent], own: str
) -> tuple[EffectTerm, ...]:
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
def findings_of(draw: st.DrawFn, name: str) -> Findings:
    """Anything that could be found of a file."""
    domain, lifted = domain_of(name), lifted_model_of(name)
    model = domain.model
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
    missing: dict[tuple[str, str], MissingEffect] = {}
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
def test_the_file_stays_and_says_what_was_found(name: str, data: st.DataObject) -> None:
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


def test_chance_changes_comments_alone() -> None:
    domain = domain_of("cliff")
    kinds = tuple(
        ObservedOutcome((("row", k),), p, 0.02, k == 1.0) for k, p in ((1.0, 0.4), (2.0, 0.6))
    )
    actions = {a.schema: a for a in domain.model.actions}.values()
    outcomes = [StochasticEffect(a.schema, a.place, kinds, 77, 0.1) for a in actions]
    repaired = repair(domain, found(*outcomes))
    assert len(repaired.changes) == repaired.text.count("; Observed: ") == len(outcomes)
    new, old = repaired.text.splitlines(), domain.source.text.splitlines()
    assert [line for line in new if line.strip()[:1] != ";"] == [
        line for line in old if line.strip()[:1] != ";"
    ]
    rest = iter(new)
    assert all(line in rest for line in old)
