"""Which parts of PDDL are supported, and what to write instead of the others."""

from __future__ import annotations

from serp._util.text import did_you_mean
from serp.pddl.sexpr import Group, Word
from serp.pddl.source import DomainError

_SUPPORTED = frozenset(
    (
        *(":strips", ":typing", ":equality", ":adl", ":conditional-effects"),
        *(":negative-preconditions", ":disjunctive-preconditions", ":quantified-preconditions"),
        *(":existential-preconditions", ":universal-preconditions"),
        *(":fluents", ":numeric-fluents", ":action-costs"),
        *(":time", ":processes", ":events", ":continuous-effects", ":hybrid"),
    )
)
_UNSUPPORTED = {
    ":durative-actions": "durative actions",
    ":duration-inequalities": "durative actions",
    ":derived-predicates": "derived predicates",
    ":timed-initial-literals": "timed initial literals",
    ":timed-initial-fluents": "timed initial fluents",
    ":preferences": "preferences",
    ":constraints": "trajectory constraints",
    ":object-fluents": "object fluents",
    ":probabilistic-effects": "probabilistic effects",
    ":rewards": "PPDDL rewards",
    ":multi-agent": "multi-agent domains",
    ":unfactored-privacy": "multi-agent domains",
    ":factored-privacy": "multi-agent domains",
    ":method-preconditions": "hierarchical domains",
    ":hierarchy": "hierarchical domains",
}
INSTEAD = {
    **dict.fromkeys(
        (":durative-action", "at", "over"),
        "write an action, and a process for what goes on meanwhile",
    ),
    **dict.fromkeys(
        (":derived", ":axiom"),
        "write the condition itself where it is used, or an event that sets the predicate",
    ),
    ":constraints": "write an event that sets `(unsafe)` where a constraint is broken",
    "preference": "write `(increase (reward) ...)` under a `when`, or as an event",
    "timed": "write a function as a clock, which a process increases, and an event",
    **dict.fromkeys((":method", ":task"), "write actions only; the planner chooses among them"),
}
"""What to write in the stead of PDDL that is not supported."""


def check_requirements(group: Group) -> None:
    """Warn of requirements that are unknown or not supported.

    Raises:
        DomainError: One of them is a list.
    """
    for node in group.items[1:]:
        if not isinstance(node, Word):
            raise DomainError("expected a requirement such as `:typing`", node.place)
        if node.text in _UNSUPPORTED:
            what = _UNSUPPORTED[node.text]
            node.place.warn(
                f"`{node.text}` is not needed: {what} are not supported, and none is used"
            )
        elif node.text not in _SUPPORTED:
            advice = did_you_mean(node.text, [*_SUPPORTED, *_UNSUPPORTED])
            node.place.warn(f"unknown requirement `{node.text}`; {advice}")
