"""The names that an expression may use, and the terms and declarations that they stand for."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter

from serp._util.did_you_mean import closest, did_you_mean
from serp._util.text import plural
from serp.pddl import syntax as x
from serp.pddl.reader import Group, Node, Word
from serp.pddl.source import DomainError, Place

INSTEAD = {
    word: advice
    for advice, words in {
        "write an action that starts it, and a process for what happens meanwhile": (
            ":durative-action :durative-actions :duration-inequalities"
        ),
        "write `(:derived (predicate ...) condition)`": ":axiom",
        "write an event that sets `(unsafe)` if a constraint is violated": (
            ":constraint :constraints :safety-constraints"
        ),
        "write `(increase (reward) ...)` under a `when`, or in an event": (
            "preference :preferences :goal-utilities"
        ),
        "declare a function as a clock, let a process increase it, and let an event read it": (
            "timed :timed-initial-literals :timed-initial-fluents :timed-effects"
        ),
        "give the likeliest value; in a task, the environment gives the real one": (
            "unknown :contingent :partial-observability :unknown"
        ),
        "write `- number`, or a predicate with an additional parameter": ":object-fluents",
        "write actions only; the planner chooses among them": (
            ":method :task :hierarchy :htn :method-preconditions :action-expansions"
        ),
        "leave it out; the environment is observed in every step": ":observe :sense",
        "write one list for all agents, with the agent as a parameter": (
            ":agent :private :multi-agent :factored-privacy :unfactored-privacy"
        ),
    }.items()
    for word in words.split()
}
"""Word or requirement of PDDL that is not supported → what to write instead."""


def unsupported(problem: str, place: Place, key: str) -> DomainError:
    """Return the error of PDDL that is not supported, with what to write instead."""
    return DomainError(problem, place, INSTEAD[key], code="unsupported")


@dataclass(frozen=True)
class Scope:
    """The names that an expression may use.

    Attributes:
        parents: Type → parent.
        objects: Objects and constants by name.
        declarations: Predicates and functions by name.
        parameters: Variables bound here.
        derived: Predicates that axioms define; no effect sets them.
        in_process: Whether effects are rates (`(* #t rate)`).
        in_action: Whether effects may happen by chance.
        in_metric: Whether `(total-time)` and `(reward)` may be read.
        math: Whether MATH_REQUIREMENT is listed.
        declares: Where objects are declared that can be named here.
    """

    parents: Mapping[str, str]
    objects: Mapping[str, x.ObjectDeclaration]
    declarations: Mapping[str, x.Declaration]
    parameters: Mapping[str, x.SchemaParameter]
    derived: frozenset[str] = frozenset()
    in_process: bool = False
    in_action: bool = False
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
            advice = f"{known or 'no variable is bound here'}{'' if meant else ';'} {binding}"
            raise _unknown("variable", node, advice, meant)
    elif term.name not in scope.objects:
        variable = f"?{term.name}"
        if variable in scope.parameters:
            raise _unknown("object", node, f"did you mean `{variable}`?", variable)
        known = did_you_mean(term.name, scope.objects) or f"declare it under {scope.declares}"
        raise _unknown("object", node, known, closest(term.name, scope.objects))
    return term


def parse_arguments(
    group: Group, declaration: x.Declaration, scope: Scope
) -> tuple[x.SchemaTerm, ...]:
    """Parse the arguments of a predicate or function."""
    what = "function" if declaration.numeric else "predicate"
    count = len(group.items) - 1
    if count != len(declaration.parameters):
        wanted = plural(len(declaration.parameters), "argument")
        problem = f"{what} `{declaration.name}` takes {wanted}, found {count}"
        raise DomainError(
            problem,
            group.place,
            f"it is declared as {declaration.place.text}",
            code="wrong-arguments",
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
                f"declare it with its type: `{term.name} - {wanted}`" if untyped else "",
                code="wrong-arguments",
            )
    return terms


def _unknown(what: str, word: Word, advice: str, guess: str | None = None) -> DomainError:
    problem = f"unknown {what} `{word.text}`"
    return DomainError(problem, word.place, advice, guess=guess, code="unknown-name")


def declared_as(group: Group, scope: Scope, *, numeric: bool) -> x.Declaration:
    """Return the declaration of the name that a list begins with."""
    what = "function" if numeric else "predicate"
    word = group.items[0] if group.items else None
    if not isinstance(word, Word):
        raise DomainError(f"expected a {what}", group.place)
    declaration = scope.declarations.get(word.text)
    if declaration is None:
        names = [d.name for d in scope.declarations.values() if d.numeric == numeric]
        known = [*names, *(x.MATH_FUNCTIONS if numeric and scope.math else ())]
        if word.text in (x.REWARD, x.UNSAFE, x.TERMINAL):
            advice = f"declare it: `(:{what}s ... ({word.text}))`"
            raise _unknown(what, word, advice)
        raise _unknown(what, word, did_you_mean(word.text, known), closest(word.text, known))
    if declaration.numeric != numeric:
        other, advice = "predicate", "a predicate is true or false, not a number"
        if not numeric:
            other, name = "function", f"({word.text})"
            advice = f"compare it: `(> {name} 0)`; as an effect, `(increase {name} 1)` changes it"
        problem = f"`{word.text}` is a {other}, but a {what} is needed here"
        raise DomainError(problem, word.place, advice, code="wrong-kind")
    return declaration


TOTAL_TIME = "total-time"
_NAME = re.compile(r"[a-z][a-z0-9_\-]*\Z")
_VARIABLE = re.compile(r"\?[a-z][a-z0-9_\-]*\Z")


def is_name(word: Word) -> bool:
    """Whether a word is a plain PDDL name."""
    return _NAME.match(word.text) is not None


def expect_name(node: Node, what: str) -> Word:
    """Return the node as a plain PDDL name."""
    if isinstance(node, Group) and node.head.startswith(":") and node.head in INSTEAD:
        raise unsupported(f"`{node.head}` is not supported", node.place.opening, node.head)
    if not isinstance(node, Word):
        raise DomainError(f"expected {what}, found a list", node.place)
    if not is_name(node):
        raise DomainError(
            f"`{node.text}` is not a valid name for {what}",
            node.place,
            "a name must begin with a letter, followed by letters, digits, `-` and `_`",
        )
    return node


def expect_group(node: Node, what: str) -> Group:
    """Return the node as a parenthesised list."""
    if isinstance(node, Word):
        raise DomainError(f"expected {what} in parentheses, found `{node.text}`", node.place)
    return node


def typed_list(
    nodes: Sequence[Node], what: str, *, variables: bool
) -> list[tuple[Word, tuple[Word, ...]]]:
    """Split `a b - t c` into (name, type names) pairs; no type names where none is written."""
    pairs: list[tuple[Word, tuple[Word, ...]]] = []
    waiting: list[Word] = []
    index = 0
    while index < len(nodes):
        node = nodes[index]
        if isinstance(node, Word) and node.text.startswith("-"):
            type_node, index = after_dash(nodes, index, "a type")
            types = _type_names(type_node)
            if not waiting:
                problem = f"`- {type_node.place.text}` needs {what} before it"
                if variables:
                    raise DomainError(problem, node.place)
                node.place.warn(problem, "needless")
            pairs += [(word, types) for word in waiting]
            waiting = []
            continue
        if variables:
            if not isinstance(node, Word) or not _VARIABLE.match(node.text):
                shown = node.text if isinstance(node, Word) else "a list"
                advice = "variables must begin with `?`, as in `?robot`"
                if waiting and isinstance(node, Word) and is_name(node):
                    last = waiting[-1].text
                    advice = f"write `{last} - {shown}` for a type, `?{shown}` for a variable"
                raise DomainError(
                    f"expected a variable for {what}, found `{shown}`", node.place, advice
                )
            waiting.append(node)
        else:
            waiting.append(expect_name(node, what))
        index += 1
    return pairs + [(word, ()) for word in waiting]


def after_dash(nodes: Sequence[Node], index: int, what: str) -> tuple[Node, int]:
    """Return what follows a `-`, and the index behind it; `-type` without a blank is warned of."""
    dash = nodes[index]
    if isinstance(dash, Word) and dash.text != "-":
        place = dash.place
        text = f"`{place.text}` is read as `- {dash.text[1:]}`; other tools may not do this"
        place.warn(text, write=f"- {place.text[1:]}")
        return Word(dash.text[1:], place.source.place(place.start + 1, place.end)), index + 1
    if index + 1 == len(nodes):
        raise DomainError(f"`-` needs {what} after it", dash.place)
    return nodes[index + 1], index + 2


def _type_names(node: Node) -> tuple[Word, ...]:
    if isinstance(node, Word):
        return (expect_name(node, "a type"),)
    if node.head != "either" or len(node.items) < 2:
        raise DomainError("expected a type or `(either type ...)`", node.place)
    return tuple(expect_name(item, "a type") for item in node.items[1:])


def declared_again(word: Node, what: str, *, same: bool) -> None:
    """Warn of a second declaration that says the same as the first; refuse one that differs."""
    problem = f"{what} `{word.place.text.lower()}` is declared twice"
    if not same:
        advice = "the two differ; leave one of them out"
        raise DomainError(problem, word.place, advice, code="declared-twice")
    word.place.warn(problem, "declared-twice")


def parse_types(group: Group) -> dict[str, str]:
    """Parse `(:types ...)` into type → parent.

    A parent that is not declared itself is a child of `object`, as other PDDL tools have it. A type
    that is declared both below `object` and below another type is below the other.
    """
    parents: dict[str, str] = {}
    places: dict[str, Place] = {}
    mentioned: list[str] = []
    for word, types in typed_list(group.items[1:], "a type", variables=False):
        if len(types) > 1:
            problem = "a type can have only one parent; `either` is for parameters"
            raise DomainError(problem, word.place, code="type-conflict")
        parent = types[0].text if types else x.OBJECT
        if word.text == x.OBJECT:
            if types:
                problem = "`object` is the root of all types"
                raise DomainError(problem, word.place, code="reserved-name")
            continue
        if (known := parents.get(word.text)) is not None:
            declared_again(word, "type", same=known == parent or x.OBJECT in (known, parent))
            parent = known if parent == x.OBJECT else parent
        parents[word.text] = parent
        places[word.text] = word.place
        mentioned.append(parent)
    for parent in mentioned:
        if parent != x.OBJECT:
            parents.setdefault(parent, x.OBJECT)
    try:
        TopologicalSorter({name: (parent,) for name, parent in parents.items()}).prepare()
    except CycleError as error:
        name = next(name for name in places if name in error.args[1])
        problem = f"type `{name}` is its own ancestor"
        raise DomainError(problem, places[name], code="type-conflict") from None
    return parents


def check_type(word: Word, parents: dict[str, str]) -> str:
    """Return the name of a declared type."""
    if word.text != x.OBJECT and word.text not in parents:
        known = [*parents, x.OBJECT]
        advice, guess = did_you_mean(word.text, known), closest(word.text, known)
        if not guess:
            others = "... " if parents else ""
            advice = f"{advice}; or declare it: `(:types {others}{word.text})`"
        raise _unknown("type", word, advice, guess)
    return word.text


def parse_parameters(
    nodes: Sequence[Node], parents: dict[str, str], *, positional: bool = False
) -> tuple[x.SchemaParameter, ...]:
    """Parse a typed list of variables."""
    parameters: dict[str, x.SchemaParameter] = {}
    for word, types in typed_list(nodes, "a parameter", variables=True):
        names = tuple(check_type(t, parents) for t in types) or (x.OBJECT,)
        name = word.text
        if name in parameters:
            declared_again(word, "parameter", same=positional or parameters[name].types == names)
            if positional:
                name = f"{name}-{len(parameters) + 1}"
        parameters[name] = x.SchemaParameter(name, names, word.place)
    return tuple(parameters.values())


def parse_objects(group: Group, parents: dict[str, str]) -> dict[str, x.ObjectDeclaration]:
    """Parse `(:constants ...)` or `(:objects ...)`."""
    objects: dict[str, x.ObjectDeclaration] = {}
    for word, types in typed_list(group.items[1:], "an object", variables=False):
        if len(types) > 1:
            raise DomainError("an object can have only one type", word.place, code="type-conflict")
        type_name = check_type(types[0], parents) if types else x.OBJECT
        if word.text in objects:
            declared_again(word, "object", same=objects[word.text].type == type_name)
        objects[word.text] = x.ObjectDeclaration(word.text, type_name, word.place)
    return objects


def parse_declarations(
    group: Group, parents: dict[str, str], declared: dict[str, x.Declaration], *, numeric: bool
) -> None:
    """Parse `(:predicates ...)` or `(:functions ...)`, and add them to what is declared."""
    what = "function" if numeric else "predicate"
    index = begin = 1
    while index < len(group.items):
        node = group.items[index]
        index += 1
        if numeric and isinstance(node, Word) and node.text.startswith("-"):
            since = group.items[begin:index]
            with node.place.source.place(since[0].place.start, node.place.end).recovering():
                kind, index = after_dash(group.items, index - 1, "`number`")
                begin = index
                _check_number_type(kind, since)
                continue
            for item in since:  # an error was taken: they are no functions of numbers
                declared.pop(item.head if isinstance(item, Group) else item.text, None)
            begin = index
            continue
        with node.place.recovering():
            if numeric and isinstance(node, Word):
                node = without_parentheses(expect_name(node, "a function"))
            declaration = _declaration(expect_group(node, f"a {what}"), parents, what)
            if declaration is None:
                continue
            name = declaration.name
            if (known := declared.get(name)) is not None:
                if known.numeric != numeric:  # what uses it as a predicate is refused there
                    problem = (
                        f"`{name}` is both a predicate and a function; it is read as a function"
                    )
                    declaration.place.warn(problem, "declared-twice")
                    declared.pop(name)  # functions come after predicates
                    declared[name] = declaration if numeric else known
                    continue
                types = [parameter.types for parameter in known.parameters]
                same = types == [parameter.types for parameter in declaration.parameters]
                declared_again(expect_group(node, what).items[0], what, same=same)
            declared[name] = declaration


def _declaration(item: Group, parents: dict[str, str], what: str) -> x.Declaration | None:
    """Parse `(name parameters)`; None for `(total-time)`, which needs no declaration."""
    if not item.items:
        raise DomainError(f"this declaration of a {what} is empty", item.place)
    numeric = what == "function"
    word = expect_name(item.items[0], f"a {what}")
    if numeric and word.text == TOTAL_TIME and len(item.items) == 1:
        item.place.warn("`(total-time)` needs no declaration", "needless", write="")
        return None
    if word.text in RESERVED_WORDS:
        raise DomainError(
            f"`{word.text}` is a PDDL keyword and cannot be the name of a {what}",
            word.place,
            code="reserved-name",
        )
    parameters = parse_parameters(item.items[1:], parents, positional=True)
    declaration = x.Declaration(word.text, parameters, numeric, item.place)
    _check_reserved(declaration)
    return declaration


def _check_reserved(declaration: x.Declaration) -> None:
    name = declaration.name
    if name not in (x.REWARD, x.UNSAFE, x.TERMINAL):
        return
    if name != x.REWARD and not declaration.numeric and declaration.parameters:
        text = f"`{name}` with parameters is an ordinary predicate, not the flag `({name})`"
        declaration.place.warn(text, "reserved-name")
        return
    if declaration.numeric != (name == x.REWARD):
        kind = "function" if name == x.REWARD else "predicate"
        problem = f"`({name})` is reserved and must be a {kind}"
    elif declaration.parameters:
        problem = f"`({name})` is reserved and takes no parameters"
    else:
        return
    advice = "if you mean something else, choose another name"
    raise DomainError(problem, declaration.place, advice, code="reserved-name")


def without_parentheses(word: Word) -> Group:
    """Return the function that a bare name means, with a warning."""
    text = f"`{word.text}` is read as `({word.text})`; other tools may not do this"
    word.place.warn(text, write=f"({word.place.text})")
    return Group((word,), word.place)


def _check_number_type(kind: Node, since: Sequence[Node]) -> None:
    """Check the type of the functions since the one before; the last of them is the dash."""
    if len(since) == 1:
        raise DomainError("`-` needs functions before it, and `number` after it", since[0].place)
    if not isinstance(kind, Word) or kind.text != "number":
        problem = "functions with values other than numbers are not supported"
        raise unsupported(problem, kind.place, ":object-fluents")


RESERVED_WORDS = frozenset(
    (
        *("and", "or", "not", "imply", "forall", "exists", "when", "either", "preference"),
        *("assign", "increase", "decrease", "scale-up", "scale-down"),
        *("define", "domain", "problem", "number", "object", TOTAL_TIME),
    )
)
