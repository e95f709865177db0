"""The names that an expression may use, and the terms and declarations that they stand for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from serp._util.text import closest, did_you_mean, plural
from serp.pddl import slips
from serp.pddl import syntax as x
from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError

INSTEAD = {
    **dict.fromkeys(
        (":durative-action", "at", "over"),
        "write an action, and a process for what goes on meanwhile",
    ),
    **dict.fromkeys(
        (":derived", ":axiom"),
        "write the condition itself where it is used, or an event that sets the predicate",
    ),
    **dict.fromkeys(
        (":constraint", ":constraints"),
        "write an event that sets `(unsafe)` where a constraint is broken",
    ),
    **dict.fromkeys(
        ("oneof", "probabilistic"),
        "effects are deterministic: write the likeliest outcome; a training learns how often it "
        "comes out otherwise",
    ),
    "preference": "write `(increase (reward) ...)` under a `when`, or as an event",
    "timed": "write a function as a clock, which a process increases, and an event",
    "unknown": "state what is likeliest; in a task the environment tells what is so",
    ":object-fluents": "write `- number`, or a predicate with one more parameter",
    **dict.fromkeys((":method", ":task"), "write actions only; the planner chooses among them"),
    **dict.fromkeys(
        (":observe", ":sense"), "leave it out; the environment is observed in every step"
    ),
    **dict.fromkeys(
        (":agent", ":private"), "write one list for all; an agent is one more parameter"
    ),
    ":vars": "write them under `:parameters`",
    ":rewards": "declare the function `(reward)`, and increase it",
}
"""PDDL that is not supported → what to write instead."""
REQUIREMENTS_INSTEAD = {
    requirement: INSTEAD[what]
    for what, requirements in {
        ":durative-action": ":durative-actions :duration-inequalities",
        ":derived": ":derived-predicates :domain-axioms :subgoal-through-axioms",
        ":constraint": ":constraints :safety-constraints",
        "preference": ":preferences :goal-utilities",
        "timed": ":timed-initial-literals :timed-initial-fluents :timed-effects",
        "oneof": ":probabilistic-effects :non-deterministic",
        "unknown": ":contingent :partial-observability :unknown",
        ":object-fluents": ":object-fluents",
        ":method": ":hierarchy :htn :method-preconditions :action-expansions",
        ":agent": ":multi-agent :factored-privacy :unfactored-privacy",
        ":rewards": ":rewards :mdp",
    }.items()
    for requirement in requirements.split()
}
"""Requirement of PDDL that is not supported → what to write instead."""


@dataclass(frozen=True)
class Scope:
    """The names that an expression may use.

    Attributes:
        parents: Type → parent.
        objects: Objects and constants by name.
        declarations: Predicates and functions by name.
        parameters: Variables bound here.
        in_process: Whether effects are rates (`(* #t rate)`).
        in_metric: Whether `(total-time)` and `(reward)` may be read.
        math: Whether MATH_REQUIREMENT is listed.
        declares: Where objects are declared that can be named here.
    """

    parents: Mapping[str, str]
    objects: Mapping[str, x.ObjectDeclaration]
    declarations: Mapping[str, x.Declaration]
    parameters: Mapping[str, x.SchemaParameter]
    in_process: bool = False
    in_metric: bool = False
    math: bool = False
    declares: str = ":constants; a domain does not know the :objects of a problem"

    def calculates(self, word: str) -> bool:
        """Whether a word is an operator; a declared function of this name comes first."""
        declared = self.declarations.get(word)
        return word in x.OPERATORS and not (declared is not None and declared.numeric)

    def bind(self, parameters: tuple[x.SchemaParameter, ...]) -> Scope:
        """Return the scope inside a quantifier or schema (inner names hide outer ones)."""
        return replace(self, parameters={**self.parameters, **{p.name: p for p in parameters}})

    def types_of(self, term: x.SchemaTerm) -> tuple[str, ...]:
        """Return the declared types of a term that is known to exist."""
        if term.is_variable:
            return self.parameters[term.name].types
        return (self.objects[term.name].type,)


def parse_term(node: Node, scope: Scope) -> x.SchemaTerm:
    """Parse an argument."""
    if not isinstance(node, Word):
        raise DomainError("expected a variable or an object, found a list", node.place)
    term = x.SchemaTerm(node.text, node.place)
    if term.is_variable:
        if term.name not in scope.parameters:
            only = next(iter(scope.parameters)) if len(scope.parameters) == 1 else None
            meant = only or closest(term.name, scope.parameters)
            binding = "`:parameters`, `forall` and `exists` bind variables"
            known = did_you_mean(meant or term.name, scope.parameters)
            raise DomainError(
                f"unknown variable `{term.name}`",
                node.place,
                f"{known or 'no variable is bound here'}{'' if meant else ';'} {binding}",
                guess=meant,
                code="unknown-variable",
            )
    elif term.name not in scope.objects:
        meant = _object_meant(term.name, scope)
        raise DomainError(
            f"unknown object `{term.name}`",
            node.place,
            f"did you mean `{meant}`?"
            if meant is not None
            else did_you_mean(term.name, scope.objects) or f"declare it under {scope.declares}",
            guess=meant,
            code="unknown-object",
        )
    return term


def _object_meant(name: str, scope: Scope) -> str | None:
    """Return the object or the variable that a name without `?` may stand for."""
    variable = f"?{name}"
    return variable if variable in scope.parameters else closest(name, scope.objects)


def parse_arguments(
    group: Group, declaration: x.Declaration, scope: Scope
) -> tuple[x.SchemaTerm, ...]:
    """Parse the arguments of a predicate or function."""
    what = "function" if declaration.numeric else "predicate"
    found = len(group.items) - 1
    if found != len(declaration.parameters):
        wanted = plural(len(declaration.parameters), "argument")
        problem = f"{what} `{declaration.name}` takes {wanted}, found {found}"
        one_more = found == len(declaration.parameters) + 1
        if one_more and not declaration.numeric and (slip := slips.truth_behind(group, problem)):
            raise slip
        raise DomainError(
            problem,
            group.place,
            f"it is declared as {declaration.place.text}",
            code="wrong-arity",
        )
    terms = tuple(parse_term(node, scope) for node in group.items[1:])
    for term, parameter in zip(terms, declaration.parameters, strict=True):
        fits = all(
            any(x.is_subtype(own, wanted, scope.parents) for wanted in parameter.types)
            for own in scope.types_of(term)
        )
        if not fits:
            untyped = not term.is_variable and scope.types_of(term) == (x.OBJECT,)
            wanted = parameter.types[0]
            raise DomainError(
                f"`{term.name}` is of type `{'/'.join(scope.types_of(term))}`, but "
                f"{what} `{declaration.name}` takes `{'/'.join(parameter.types)}` there",
                term.place,
                f"give it one where it is declared: `{term.name} - {wanted}`" if untyped else "",
                code="wrong-type",
            )
    return terms


def declared_as(group: Group, scope: Scope, *, numeric: bool) -> x.Declaration:
    """Return the declaration of the name that a list begins with."""
    what = "function" if numeric else "predicate"
    word = group.items[0] if group.items else None
    if not isinstance(word, Word):
        raise DomainError(f"expected a {what}", group.place)
    declaration = scope.declarations.get(word.text)
    if declaration is None:
        names = [d.name for d in scope.declarations.values() if d.numeric == numeric]
        section = ":functions" if numeric else ":predicates"
        known = [*names, *(x.MATH_FUNCTIONS if numeric and scope.math else ())]
        advice, guess = did_you_mean(word.text, known), closest(word.text, known)
        if word.text in (x.REWARD, x.UNSAFE, x.TERMINAL):
            advice, guess = f"declare it: `({section} ... ({word.text}))`", None
        raise DomainError(
            f"unknown {what} `{word.text}`", word.place, advice, guess=guess, code="unknown-name"
        )
    if declaration.numeric != numeric:
        is_what, wanted = ("function", "predicate") if not numeric else ("predicate", "function")
        raise DomainError(
            f"`{word.text}` is a {is_what}, a {wanted} is needed here",
            word.place,
            code="wrong-kind",
        )
    return declaration
