"""Corrections of common mistakes: forms that are not PDDL, and what to write instead.

Each function looks at a form that is about to be refused, and returns an error that says more than
"unknown predicate", or None. Names that the file declares are never taken for a slip.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

from serp.pddl.sexpr import Group, Node, Word
from serp.pddl.source import DomainError
from serp.pddl.syntax import Declaration

_COMMA = re.compile(r"([+-]?\d+),(\d+)\Z", re.ASCII)
_COMPARISONS = {
    **{operator: operator for operator in ("<", "<=", "=", ">=", ">")},
    **{"==": "=", "=<": "<=", "=>": ">=", "!=": "not =", "<>": "not ="},
}
_ARITHMETIC = {operator: operator for operator in "+-*/"}
_CONNECTIVES = {
    **{"&&": "and", "&": "and", "||": "or", "|": "or", "!": "not"},
    **{"->": "imply", "implies": "imply", "if": "imply", "exist": "exists", "all": "forall"},
}
_INFIX = {**_COMPARISONS, "and": "and", "&&": "and", "or": "or", "||": "or", "->": "imply"}
_CHANGES = {
    **{"=": "assign", "set": "assign", ":=": "assign", "<-": "assign"},
    **{"+=": "increase", "-=": "decrease", "*=": "scale-up", "/=": "scale-down"},
}
_TRUTH = {"true": True, "1": True, "false": False, "0": False}
_MATH = {
    "abs": "write two conditions, or two effects under `when`: one where it is negative",
    "sqrt": "compare squares instead of roots",
    "min": "write an effect under `when` for each case, or an event that limits the number",
    "max": "write an effect under `when` for each case, or an event that limits the number",
    **dict.fromkeys(
        ("pow", "exp", "log", "sin", "cos", "tan", "mod", "%", "**", "floor", "round"),
        "declare a function whose value the grounding gives",
    ),
}
Declared = Mapping[str, Declaration]


def decimal_comma(word: Word) -> DomainError | None:
    """Recognise `0,5`."""
    if not (match := _COMMA.match(word.text)):
        return None
    return DomainError(
        f"expected a number, found `{word.text}`",
        word.place,
        "decimals have a point",
        write=f"{match[1]}.{match[2]}",
    )


def in_number(group: Group, declared: Declared) -> DomainError | None:
    """Recognise infix arithmetic, functions of other languages, and a number in parentheses."""
    head = group.head
    if infix := _infix(group, _ARITHMETIC, declared):
        return infix
    if head in declared:
        return None
    if head in _MATH:
        return DomainError(
            f"`{head}` is not supported; numbers have `+`, `-`, `*` and `/`",
            group.items[0].place,
            _MATH[head],
        )
    if len(group.items) == 1 and head[:1].isdigit():
        return DomainError("a number has no parentheses", group.place, write=head)
    return None


def in_condition(group: Group, declared: Declared) -> DomainError | None:
    """Recognise infix comparisons, words of other languages, and a missing `and`."""
    head = group.head
    if infix := _infix(group, _INFIX, declared):
        return infix
    if head in declared:
        return None
    if head in _COMPARISONS and len(group.items) == 3:
        return _comparison(group, declared)
    if head in _COMPARISONS and len(group.items) > 3:
        pairs = (_prefix(_COMPARISONS[head], pair, declared) for pair in pairwise(group.items[1:]))
        return DomainError(
            f"`{head}` compares two things", group.place, write=f"(and {' '.join(pairs)})"
        )
    if head == "when":
        why = "`when` stands in an effect; in a condition it is called `imply`"
        return _instead(group, why, "imply", declared)
    if head in _CONNECTIVES:
        return _instead(group, f"`{head}` is not PDDL", _CONNECTIVES[head], declared)
    return _missing_and(group, "conditions")


def _comparison(group: Group, declared: Declared) -> DomainError | None:
    """Recognise what is wrong in `(operator left right)`, be the operator PDDL's or not."""
    operator = _COMPARISONS[group.head]
    left, right = group.items[1:]
    if operator != group.head:
        return _instead(group, f"`{group.head}` is not PDDL", operator, declared)
    if operator == "=" and (atom := _with_truth(left, right, declared)):
        return DomainError("a predicate is a condition by itself", group.place, write=atom)
    if "abs" in declared:
        return None
    if isinstance(right, Group) and right.head == "abs":
        left, right = right, left
        operator = operator.translate(str.maketrans("<>", "><"))
    if isinstance(left, Group) and left.head == "abs" and len(left.items) == 2:
        inside, limit = _operand(left.items[1], declared), _operand(right, declared)
        below = limit.removeprefix("-") if limit.startswith("-") else f"-{limit}"
        if isinstance(right, Group):
            below = f"(- 0 {limit})"
        word = "and" if operator[0] == "<" else "or"
        mirrored = operator.translate(str.maketrans("<>", "><"))
        return DomainError(
            "`abs` is not supported; numbers have `+`, `-`, `*` and `/`",
            group.place,
            _MATH["abs"],
            write=f"({word} ({operator} {inside} {limit}) ({mirrored} {inside} {below}))",
        )
    return None


def in_effect(group: Group, declared: Declared) -> DomainError | None:
    """Recognise assignments and conditions of other languages, and a missing `and`."""
    head = group.head
    if infix := _infix(group, _CHANGES, declared):
        return infix
    if head in declared:
        return None
    pair = group.items[1:] if len(group.items) == 3 else ()
    if pair and head in (*_CHANGES, "assign") and (atom := _with_truth(*pair, declared)):
        return DomainError("a predicate is an effect by itself", group.place, write=atom)
    if pair and head in _CHANGES:
        why = f"`{head}` is not supported in an effect"
        return _instead(group, why, _CHANGES[head], declared)
    if len(group.items) == 4 and head in _CHANGES.values():
        target, between, value = group.items[1:]
        if isinstance(between, Word) and between.text in ("by", "to", "="):
            why = f"`{head}` takes a function and a value"
            text = f"({head} {_operand(target, declared)} {_operand(value, declared)})"
            return DomainError(why, group.place, write=text)
    if head == "if" and len(group.items) in (3, 4):
        condition, then, *otherwise = (written(node) for node in group.items[1:])
        text = f"(when {condition} {then})"
        if otherwise:
            text = f"(and {text} (when (not {condition}) {otherwise[0]}))"
        return DomainError(
            "`if` is not supported in an effect", group.place, "it is called `when`", write=text
        )
    return _missing_and(group, "effects")


def several_under(key: str, nodes: Sequence[Node]) -> DomainError:
    """Return the error of several forms where a field takes one."""
    first, last = nodes[0].place, nodes[-1].place
    return DomainError(
        f"`{key}` takes one form, found {len(nodes)}",
        first.source.place(first.start, last.end),
        "put them under `and`",
        write=_under_and(nodes),
    )


def several_after(group: Group, at: int, problem: str) -> DomainError:
    """Return the error of a form whose items from one position on have to be one."""
    if len(group.items) <= at + 1 or any(isinstance(node, Word) for node in group.items[at:]):
        return DomainError(problem, group.place)
    kept = " ".join(written(node) for node in group.items[:at])
    text = f"({kept} {_under_and(group.items[at:])})"
    return DomainError(problem, group.place, "put several under `and`", write=text)


def written(node: Node) -> str:
    """Return a form as it is written, in one line and without comments."""
    if isinstance(node, Group):
        return f"({' '.join(written(item) for item in node.items)})"
    return node.place.text


def _infix(group: Group, words: Mapping[str, str], declared: Declared) -> DomainError | None:
    if len(group.items) != 3:
        return None
    left, middle, right = group.items
    if not isinstance(middle, Word):
        return None
    if group.head in declared and len(declared[group.head].parameters) == 2:
        return None  # an object may be called `or`
    if middle.text not in words or (isinstance(left, Word) and left.text in words):
        return None
    atom = _with_truth(left, right, declared) if words[middle.text] in ("=", "assign") else ""
    return DomainError(
        f"`{middle.text}` stands between what it is applied to",
        group.place,
        "in PDDL the operator comes first",
        write=atom or _prefix(words[middle.text], (left, right), declared),
    )


def _instead(group: Group, problem: str, word: str, declared: Declared) -> DomainError:
    return DomainError(problem, group.place, write=_prefix(word, group.items[1:], declared))


def _prefix(word: str, operands: Sequence[Node], declared: Declared) -> str:
    shown = " ".join(_operand(node, declared) for node in operands)
    return f"(not (= {shown}))" if word == "not =" else f"({word} {shown})"


def _operand(node: Node, declared: Declared) -> str:
    text = written(node)
    if isinstance(node, Word):
        if node.text in declared and not declared[node.text].parameters:
            return f"({text})"
        return _COMMA.sub(r"\1.\2", text)
    return text


def _with_truth(left: Node, right: Node, declared: Declared) -> str:
    """Return the condition or effect that `(= predicate true)` means; empty for anything else."""
    if not isinstance(right, Word) or right.text not in _TRUTH:
        return ""
    atom = written(left) if isinstance(left, Group) else f"({written(left)})"
    name = left.head if isinstance(left, Group) else left.text
    if name not in declared or declared[name].numeric:
        return ""
    return atom if _TRUTH[right.text] else f"(not {atom})"


def _missing_and(group: Group, what: str) -> DomainError | None:
    if group.items and all(isinstance(node, Group) for node in group.items):
        problem = f"{what} stand in a list without `and`"
        if len(group.items) == 1:
            return DomainError("one pair of parentheses too many", group.place,
                               write=written(group.items[0]))  # fmt: skip
        return DomainError(problem, group.place, write=_under_and(group.items))
    return None


def _under_and(nodes: Sequence[Node]) -> str:
    """Join forms under one `and`; those that are conjunctions give their parts."""
    parts: list[str] = []
    for node in nodes:
        inner = node.items[1:] if isinstance(node, Group) and node.head == "and" else (node,)
        parts += map(written, inner)
    return f"(and {' '.join(parts)})"
