"""Where new effects and processes go."""

from __future__ import annotations

import pytest

from serp.pddl.source import Source
from serp.runs.diagnosis.findings import EffectTerm, MissingEffect
from serp.runs.diagnosis.repair import InsertionPoints, repair
from tests.serp.model.learned.rolls import from_text
from tests.serp.runs.diagnosis.made_up import found, kept, written

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
    assert kept(text, repaired.text)
    for line in repaired.text.splitlines():  # each comment is where it was
        if "; one" in line:
            assert "(increase (f) 1.0)" in line
    assert "(:requirements :strips :numeric-fluents :time)" in repaired.text


def test_processes_follow_the_last_one() -> None:
    text = """(define (domain d)
  (:functions (f))
  (:action a :parameters () :precondition (and) :effect (and))
  (:process p :parameters () :precondition (and) :effect (and (increase (f) (* #t 1))))  ; slow
  (:event e :parameters () :precondition (and) :effect (and (assign (f) 0))))
"""
    for old, after in ((text, "; slow"), (text.replace("(:process", "(:event"), "(and))")):
        edit = InsertionPoints(Source("d.pddl", old)).process(
            "new", "?x - t", [("why", "(effect)")]
        )
        assert old[: edit.start].endswith(after)
        assert edit.text == (
            "\n\n  (:process new\n    :parameters (?x - t)\n    :precondition (and)\n"
            "    :effect (and\n      ; why\n      (effect)))"
        )


@pytest.mark.parametrize(
    ("listed", "added"),
    [
        ("(:requirements :strips)", " :time :numeric-fluents"),
        ("(:requirements :strips :fluents)", " :time"),
        ("(:requirements :time :numeric-fluents)", None),
        ("(:requirements :hybrid)", None),
    ],
)
def test_what_is_needed_is_required(listed: str, added: str | None) -> None:
    layout = InsertionPoints(Source("d.pddl", f"(define (domain d)\n  {listed})"))
    edits = layout.requirements([":time", ":numeric-fluents"])
    assert [edit.text for edit in edits] == ([] if added is None else [added])
