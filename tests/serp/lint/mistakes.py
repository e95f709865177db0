"""Sixty mistakes, one edit each, in copies of shipped domains, and what is to be said of them.

They were written down before the rules that find them, from what newcomers to PDDL and experts in a
hurry do: signs and parentheses lost, copies left unchanged, words of other languages, units mixed.
"""

from __future__ import annotations

from typing import NamedTuple

RESTORES = "the fix of the finding gives the original back"


class Mistake(NamedTuple):
    """One edit.

    Attributes:
        file: Name of a shipped file, without its ending.
        old: What the file says, once.
        new: What it is made to say; `«` and `»` enclose the place that is to be named. Without them
            the place is `place`.
        code: The code of the finding.
        suggestion: RESTORES, words of the advice, or empty where nobody could know.
        place: A text of the file, once, where the finding is to be.
    """

    file: str
    old: str
    new: str
    code: str
    suggestion: str = ""
    place: str = ""


# fmt: off
MISTAKES = [
    # Parentheses and characters ------------------------------------------------------------------
    Mistake("cartpole", "(increase (pole-velocity) 0.29)))", "(increase (pole-velocity) 0.29))«»",
            "unbalanced-parentheses", RESTORES),
    Mistake("cartpole", "(* #t (cart-velocity)))))", "(* #t (cart-velocity)))))«)»",
            "unbalanced-parentheses", RESTORES),
    Mistake("soccer", "(assign (robot-to-ball) 0.20)))", "(assign (robot-to-ball) 0.20))«»  ; ends)",
            "unbalanced-parentheses", RESTORES),
    Mistake("taxi", "(and (< (row) 4))", "(and (< (row) 4)«»", "unbalanced-parentheses", RESTORES),
    Mistake("cartpole", "(< (pole-angle) -0.2618)", "(< (pole-angle) «−0.2618»)",
            "bad-number", RESTORES),
    Mistake("cartpole", "; the farther the pole leans, the faster it falls",
            "«//» the farther the pole leans", "stray-text", "comments begin with `;`"),
    Mistake("landing", "(* 0.03 (offset))", "(* «0,03» (offset))", "bad-number", RESTORES),
    Mistake("cliff", "(and (= (row) 3) (= (column) 11))", "«{and (= (row) 3) (= (column) 11)}»",
            "stray-text", RESTORES),
    # Words and forms -----------------------------------------------------------------------------
    Mistake("cartpole", "(:action push-left", "(«action» push-left", "unknown-section", RESTORES),
    Mistake("cliff", "(:event fall\n    :parameters ()\n    :precondition",
            "(:event fall\n    :parameters ()\n    «:preconditions»", "unknown-field", RESTORES),
    Mistake("soccer", "(:process opponent-approaches\n    :parameters ()\n    :precondition",
            "(:process opponent-approaches\n    :parameters ()\n    «precondition»",
            "unknown-field", RESTORES),
    Mistake("cartpole", "(and (> (pole-angle) 0.0))", "(and «((pole-angle) > 0.0)»)",
            "foreign-syntax", RESTORES),
    Mistake("taxi", "(= (row) (row-of ?p)) (= (column) (column-of ?p)))\n    :effect (and (not (aboard))",
            "«(== (row) (row-of ?p))» (= (column) (column-of ?p)))\n    :effect (and (not (aboard))",
            "foreign-syntax", RESTORES),
    Mistake("cliff", "(when (> (row) 0) (decrease (row) 1))",
            "«(if (> (row) 0) (decrease (row) 1))»", "foreign-syntax", RESTORES),
    Mistake("door-key", "(not (has-key)) (= (+ (x) (dx)) (key-x))",
            "«(! (has-key))» (= (+ (x) (dx)) (key-x))", "foreign-syntax", RESTORES),
    Mistake("cliff", "(and (terminal))", "«(terminal true)»", "wrong-arity", "takes 0 arguments"),
    Mistake("cliff", "(and (decrease (reward) 30.0) (unsafe) (terminal))",
            "«(decrease (reward) 30.0) (unsafe) (terminal)»", "missing-and", RESTORES),
    Mistake("cliff", "(and (when (> (row) 0) (decrease (row) 1)))",
            "(and («wehn» (> (row) 0) (decrease (row) 1)))", "foreign-syntax", RESTORES),
    Mistake("cartpole", "(increase (cart-position) (* #t (cart-velocity)))",
            "(increase (cart-position) «(cart-velocity)»)", "process-effect", RESTORES),
    Mistake("cartpole", "(decrease (cart-velocity) 0.195)",
            "(decrease (cart-velocity) (* «#t» 0.195))", "process-effect", "in a process"),
    Mistake("cartpole", "(and (increase (reward) 1.0))", "(and «(assign (reward) 1.0)»)",
            "reserved-use", RESTORES),
    # Names and types -----------------------------------------------------------------------------
    Mistake("cartpole", "(increase (pole-angle) (*", "(increase («pole-angel») (*",
            "unknown-name", RESTORES),
    Mistake("cartpole", "(* 0.1 (cart-position))", "(* 0.1 («cart_position»))",
            "unknown-name", RESTORES),
    Mistake("cartpole", "(:predicates\n    (unsafe)     ; \"this damages the robot\": serp avoids it"
            " as long as anything else is possible\n    (terminal))",
            "(:predicates\n    (terminal))", "unknown-name", "declare it", "(«unsafe») (terminal))))"),
    Mistake("taxi", "(:action pick-up\n    :parameters (?p - place)",
            "(:action pick-up\n    :parameters (?q - place)", "unknown-variable", "did you mean `?q`?",
            "(waits «?p») (= (row) (row-of ?p)) (= (column) (column-of ?p)))\n    :effect (and (not (waits"),
    Mistake("taxi", "(waits ?p) (wanted ?p)", "(waits ?p) (wanted «p»)", "unknown-object", RESTORES),
    Mistake("soccer", "(pushed ?s - side)", "(pushed ?s - «sides»)", "unknown-type", RESTORES),
    Mistake("taxi-problem", "(wanted blue)", "(wanted «bleu»)", "unknown-object", RESTORES),
    Mistake("taxi", "(waits ?p) (wanted ?p)", "«(waits ?p ?p)» (wanted ?p)", "wrong-arity",
            "declared as (waits ?p - place)"),
    Mistake("soccer", "(not (lined)) (> (robot-to-ball) 0.27)",
            "«(= (lined) false)» (> (robot-to-ball) 0.27)", "foreign-syntax", RESTORES),
    Mistake("soccer", "(and (pushed ?s) (free ?s))", "(and (pushed ?s) («goal-open» ?s))",
            "wrong-kind"),
    Mistake("lunar-lander", "(:event lost", "(:event «brake»", "declared-twice", "names of actions"),
    Mistake("cartpole", "(increase (cart-velocity) 0.195)", "(increase «0.195» (cart-velocity))",
            "malformed", RESTORES),
    Mistake("cliff", "(when (< (column) 11) (increase (column) 1))",
            "(when «(increase (column) 1)» (< (column) 11))", "wrong-kind", RESTORES),
    Mistake("taxi-problem", "(= (row-of blue) 4) ", "", "missing-value", "(= (row-of blue)",
            "(:init"),
    Mistake("taxi-problem", "(= (row) 2) (= (column) 2)", "(= (row) 2) «(= (row) 2)»",
            "declared-twice"),
    # Conditions that never or always hold ----------------------------------------------------------
    Mistake("cartpole", "(or (> (pole-angle) 0.2618) (< (pole-angle) -0.2618)",
            "(and (> (pole-angle) 0.2618) «(< (pole-angle) -0.2618)»",
            "contradictory-condition", "`or`"),
    Mistake("cartpole", "(> (pole-angle) 0.2618) (< (pole-angle) -0.2618)",
            "(> (pole-angle) 0.2618) «(< (pole-angle) 0.2618)»", "always-true", RESTORES),
    Mistake("soccer", "(and (not (terminal)) (< (robot-to-ball) 0.27) (> (opponent-to-ball) 0.5))",
            "(and (not (terminal)) (> (robot-to-ball) 0.27) «(< (robot-to-ball) 0.2)»)",
            "contradictory-condition"),
    Mistake("landing", "(<= (sideways) 0.5) (>= (sideways) -0.5)",
            "(<= (sideways) -0.5) «(>= (sideways) 0.5)»", "contradictory-condition"),
    Mistake("cliff", "(> (column) 0) (< (column) 11)", "«(> (column) 0)» (> (column) 11)",
            "redundant-condition", "(> (column) 11)"),
    Mistake("cartpole", "(> (cart-position) 2.4) (< (cart-position) -2.4)",
            "(> (cart-position) 2.4) «(> (cart-position) 2.4)»", "redundant-condition"),
    Mistake("taxi", "(= (row) (row-of ?p)) (= (column) (column-of ?p)))\n    :effect (and (not (waits",
            "«(= (row) (row))» (= (column) (column-of ?p)))\n    :effect (and (not (waits",
            "always-true"),
    Mistake("corner-kick", "(and (taken) (< (shot-in) 3.0))",
            "(and (taken) «(not (taken))» (< (shot-in) 3.0))", "dead-effect"),
    Mistake("cliff", "(and (= (row) 3) (> (column) 0) (< (column) 11))", "(and)",
            "always-unsafe", "", "(:event fall"),
    # Effects and rewards that come to nothing -------------------------------------------------------
    Mistake("cartpole", "(increase (cart-position) (* #t (cart-velocity)))",
            "(increase (cart-velocity) (* #t (cart-velocity)))", "frozen-fluent",
            "", "(cart-position)   ; metres"),
    Mistake("cartpole", "(increase (pole-angle) (* #t (pole-velocity)))",
            "(increase (pole-angle) (* #t (pole-angle)))", "never-read", "",
            "(pole-velocity)   ; radians"),
    Mistake("taxi", "(:event arrive\n    :parameters (?p - place)\n    :precondition (and (waits ?p)"
            " (wanted ?p))\n    :effect (and (increase (reward) 21) (terminal))",
            "(:event arrive\n    :parameters (?p - place)\n    :precondition (and (waits ?p)"
            " (wanted ?p))\n    :effect (and «(increase (row) 21)» (terminal))", "out-of-range"),
    Mistake("soccer", "(decrease (reward) 4.0)", "«(decrease (reward) -4.0)»", "double-negative",
            RESTORES),
    Mistake("cliff", "(increase (row) 1)", "«(increase (row) 0)»", "no-change"),
    Mistake("taxi", "(and (not (waits ?p)) (aboard)", "(and «(not (aboard))» (aboard)",
            "set-and-unset"),
    Mistake("door-key", "(assign (dx) (- 0 (dy))) (assign (dy) (dx))",
            "(assign (dx) (- 0 (dy))) «(assign (dy) (dy))»", "no-change"),
    Mistake("cartpole", "(increase (cart-velocity) 0.195)\n      (decrease (pole-velocity) 0.29)",
            "(decrease (cart-velocity) 0.195)\n      (increase (pole-velocity) 0.29)",
            "same-schema", "push-left", "(:action push-right"),
    Mistake("cliff", "(:event goal\n    :parameters ()\n    :precondition (and (= (row) 3) (= (column) 11))",
            "(:event goal\n    :parameters ()\n    :precondition (and (= (row) 3) (= (column) 11)"
            " «(unsafe)»)", "flag-never-set", ""),
    Mistake("corner-kick", "(and (decrease (ball-in) 0.4) (increase (robot-to-mark) 0.10))",
            "(and (decrease (ball-in) 0.4) «(assign (ball-in) 0.10)»)", "contradictory-effects"),
    Mistake("cartpole", "(/ (pole-angle) 0.2618)", "(/ (pole-angle) «0.0»)", "no-result"),
    # Units and places that the task does not know ---------------------------------------------------
    Mistake("cartpole", "(or (> (pole-angle) 0.2618)", "(or «(> (pole-angle) 15)»", "out-of-range"),
    Mistake("soccer", "(> (goal-open) 0.35)", "«(> (goal-open) 35)»", "out-of-range"),
    Mistake("mountain-car", "(>= (position) 0.5)", "«(>= (position) 50)»", "out-of-range"),
    Mistake("taxi", ":numeric-fluents :time)", ":numeric-fluents)", "missing-requirement", RESTORES,
            "(:requirements"),
]
# fmt: on
