"""Findings in words, and in PDDL."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.transition_model import TransitionModel
from serp.runs.diagnosis.findings import EffectTerm, decimal
from tests.serp.runs.diagnosis.made_up import chances, missing, parameter

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


def line_of(text: str, model: TransitionModel) -> int:
    source = model.actions[0].place.source.text
    return source[: source.index(text)].count("\n") + 1


def test_a_remark_says_what_to_write(model: TransitionModel) -> None:
    line = line_of("0.2 (*", model)
    assert parameter(model, 1, 0.4).sentence(model.ground) == (
        f"`drive`, line {line}: write 0.40 instead of 0.2 for `(battery)`; "
        "observed 0.40 ± 0.02 in 412 steps"
    )
    line = line_of("(:action drive", model)
    absent = missing(model, "warmth", {("place ?r",): -0.5, (): 2.0})
    assert absent.sentence(model.ground) == (
        f"`drive`, line {line}: add `(decrease (warmth) (* 0.50 (place ?r))) "
        "(increase (warmth) 2.00)`; observed in 412 steps"
    )
    lasting = replace(absent, schema="", place=None, terms=absent.terms[1:])
    assert lasting.sentence(model.ground) == (
        "after every action: add a process with `(increase (warmth) (* #t 2.00))`; "
        "observed in 412 steps"
    )


def test_outcomes_have_their_probabilities(model: TransitionModel) -> None:
    line = line_of("(:action drive", model)
    finding = chances(
        model, "drive", ({"place": 1.5}, 0.334, True), ({}, 0.333, False),
        ({"place": -1.0, "lit ?r": -1.0}, 0.333, False),
    )  # fmt: skip
    assert finding.sentence(model.ground) == (
        f"`drive`, line {line}: does what the file says ((place) +1.5) in 33 ± 2 % of 412 steps; "
        "instead nothing changes in 33 ± 2 %, (place) −1 and (lit ?r) becomes false in 33 ± 2 %"
    )
    never = chances(model, "light", ({"lit": 1.0}, 1.0, False))
    assert (
        "never does what the file says, in 412 steps; instead (lit) becomes true"
        in never.sentence(model.ground)
    )
