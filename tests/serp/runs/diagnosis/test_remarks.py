from __future__ import annotations

from pathlib import Path

from serp import load_domain
from serp.model.transition_model import TransitionModel
from serp.runs.diagnosis.findings import EffectTerm, Findings, MissingEffect, ParameterFinding
from serp.runs.diagnosis.remarks import remarks, terms
from tests.serp.runs.diagnosis.made_up import chances, found, missing, parameter

CARTPOLE = Path(__file__).parents[4] / "domains" / "cartpole.pddl"


def texts(findings: Findings, model: TransitionModel) -> list[str]:
    return [remark.text for remark in remarks(findings, model.ground)]


def line_of(text: str, model: TransitionModel) -> int:
    source = model.actions[0].place.source.text
    return source[: source.index(text)].count("\n") + 1


def test_a_literal_and_what_is_missing_beside_it_are_told_together() -> None:
    model = load_domain(CARTPOLE).model
    parameter = model.parameters[1]
    action = model.actions[0]
    findings = found(
        ParameterFinding(parameter, "push-left", "pole-velocity", 0.29, 0.2103, 0.021, 412, 0.5),
        MissingEffect(
            "push-left", action.place, "pole-velocity",
            (EffectTerm(0.3123, 0.02, ("pole-angle",)),), 412, 0.25,
        ),
    )  # fmt: skip
    (remark,) = remarks(findings, model.ground)
    assert remark.text == (
        "`push-left`, line 39: `(increase (pole-velocity) 0.29)`; observed 0.21 ± 0.02 in 412 "
        "steps; plus 0.31 × pole-angle that the file does not mention"
    )
    assert remark.cost == 0.75
    assert remark.line == 39
    assert len(remark.findings) == 2


def test_a_literal_among_others_is_named(model: TransitionModel) -> None:
    effect = "(decrease (battery ?r) (+ 0.2 (* 0.1 (place ?r))))"
    findings = found(parameter(model, 1, 0.4), parameter(model, 2, 0.3))
    assert texts(findings, model) == [
        f"`drive`, line {line_of(effect, model)}: `{effect}`; observed 0.40 ± 0.02 for 0.2 in 412 "
        "steps; observed 0.30 ± 0.02 for 0.1 in 412 steps"
    ]


def test_a_literal_that_agrees_is_left_out(model: TransitionModel) -> None:
    assert texts(found(parameter(model, 0, 1.53)), model) == []
    assert len(texts(found(parameter(model, 0, 1.55)), model)) == 1
    exact = parameter(model, 0, 1.5 + 1e-13, error=0.0)
    assert texts(found(exact), model) == []


def test_what_the_file_is_silent_of(model: TransitionModel) -> None:
    line = line_of("(:action drive", model)
    assert texts(found(missing(model, "warmth", {("place ?r",): 0.5, (): -2.0})), model) == [
        f"`drive`, line {line}: `(warmth)` changes by 0.50 × (place ?r) − 2.00, which the file "
        "does not mention (412 steps)"
    ]
    (text,) = texts(found(missing(model, "place ?r", {(): 0.5})), model)
    assert "changes by 0.50, beyond what the file says" in text
    (text,) = texts(found(missing(model, "place ?robot", {(): 0.5}, schema="")), model)
    assert text == (
        "whatever the action: `(place ?robot)` changes by 0.50 per unit of time, which the file "
        "does not mention (412 steps)"
    )


def test_outcomes_are_told_with_how_often_they_come(model: TransitionModel) -> None:
    line = line_of("(:action drive", model)
    finding = chances(
        model, "drive", ({"place": 1.5}, 0.334, True), ({}, 0.333, False),
        ({"place": -1.0, "lit ?r": -1.0}, 0.333, False),
    )  # fmt: skip
    assert texts(found(finding), model) == [
        f"`drive`, line {line}: does what the file says ((place) +1.5) in 33 ± 2 % of 412 steps; "
        "instead nothing changes in 33 ± 2 %, (place) −1 and (lit ?r) becomes false in 33 ± 2 %"
    ]
    (text,) = texts(found(chances(model, "light", ({"lit": 1.0}, 1.0, False))), model)
    assert "never does what the file says, in 412 steps; instead (lit) becomes true" in text


def test_a_sum_is_written_with_its_signs() -> None:
    assert terms([EffectTerm(-0.5, 0.1, ("a",)), EffectTerm(0.25, 0.01, ("a", "b c"))]) == (
        "−0.50 × a + 0.250 × a × (b c)"
    )
    assert terms([]) == "0"
