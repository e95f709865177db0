"""Corrections of common mistakes: forms that are not PDDL, and what to write instead.

Each function looks at a form that is about to be refused, and returns an error that says more than
"unknown predicate", or None. Names that the file declares are never taken for a slip.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from serp.pddl.reader import Group, Node, Word
from serp.pddl.source import DomainError, Edit, Fix, Place
from serp.pddl.syntax import MATH_FUNCTIONS, MATH_REQUIREMENT, Declaration

_COMMA = re.compile(r"([+-]?\d+),(\d+)\Z", re.ASCII)
_UNIT = re.compile(r"([+-]?\d+(?:\.\d+)?)[a-z°%][^\d]*\Z", re.ASCII)
_DASHES = dict.fromkeys(map(ord, "\u2212\u2013\u2014\u2010\u2011"), "-")
_COMPARISONS = {"==": "=", "=<": "<=", "=>": ">=", "!=": "not =", "<>": "not ="}
_CONNECTIVES = {"&&": "and", "&": "and", "||": "or", "|": "or", "->": "imply"}
_CONDITIONS = {
    **_COMPARISONS,
    **_CONNECTIVES,
    **{"implies": "imply", "if": "imply", "when": "imply"},
    **{"!": "not", "exist": "exists", "all": "forall"},
}
_INFIX = {
    **{word: word for word in ("<", "<=", "=", ">=", ">", "and", "or")},
    **_COMPARISONS,
    **_CONNECTIVES,
}
_EFFECTS = {
    **{"=": "assign", "set": "assign", ":=": "assign", "<-": "assign", "if": "when"},
    **{"+=": "increase", "-=": "decrease", "*=": "scale-up", "/=": "scale-down"},
}
_ARITHMETIC = "+-*/"
_TRUTH = {"true": True, "1": True, "false": False, "0": False}
_MATH = {
    **dict.fromkeys(("^", "**", "pow"), "write a product, or `(sqrt ...)` for a root"),
    "tan": "write `(/ (sin ...) (cos ...))`",
    "hypot": "write `(sqrt (+ (* a a) (* b b)))`",
    **dict.fromkeys(("atan", "arctan", "arctan2"), "write `(atan2 y x)`, or `(atan2 y 1)`"),
    **{"fabs": "write `abs`", "minimum": "write `min`", "maximum": "write `max`"},
    **dict.fromkeys(
        ("exp", "log", "mod", "%", "floor", "round", "asin", "acos"),
        "declare a function whose value the grounding gives",
    ),
}
"""Function of other languages → what to write in its stead."""
Declared = Mapping[str, Declaration]


class Form(NamedTuple):
    """What a form is meant to be, and what stands in its stead in other languages.

    Attributes:
        what: In messages.
        infix: Operators between their operands → word of PDDL.
        other: Words at the beginning → word of PDDL.
        compares: Words that compare with a truth value, or set to one.
        words: Words of PDDL that may be misspelt.
    """

    what: str
    infix: Mapping[str, str]
    other: Mapping[str, str]
    compares: Collection[str]
    words: Sequence[str]


CONDITION = Form(
    "a condition",
    _INFIX,
    _CONDITIONS,
    ("=", "=="),
    ("and", "or", "not", "imply", "exists", "forall"),
)
EFFECT = Form(
    "an effect",
    _EFFECTS,
    _EFFECTS,
    (*_EFFECTS, "assign"),
    ("and", "not", "when", "forall", "assign", "increase", "decrease"),
)


def _foreign(problem: str, place: Place, write: str, advice: str = "") -> DomainError:
    """Return the error of a form of another language."""
    return DomainError(problem, place, advice, write=write, code="foreign-syntax")


def in_word(word: Word) -> DomainError | None:
    """Recognise `0,5`, `2.0m`, and a minus that is none."""
    problem = f"expected a number, found `{word.text}`"
    plain = word.text.translate(_DASHES)
    if plain != word.text:
        return DomainError(problem, word.place, "write a minus as `-`", write=plain)
    if match := _COMMA.match(word.text):
        point = f"{match[1]}.{match[2]}"
        return DomainError(problem, word.place, "write decimals with a point", write=point)
    if match := _UNIT.match(word.text):
        advice = "write numbers without a unit; give the unit in a comment"
        return DomainError(problem, word.place, advice, guess=match[1])
    return None


def in_number(group: Group, declared: Declared) -> DomainError | None:
    """Recognise infix arithmetic, functions of other languages, and a number in parentheses."""
    head = group.head
    if infix := _infix(group, {operator: operator for operator in _ARITHMETIC}, declared):
        return infix
    if head in declared:
        return None
    if head in _MATH:
        more = "`, `".join(MATH_FUNCTIONS)
        problem = f"`{head}` is not supported; arithmetic has `+`, `-`, `*`, `/` and, with "
        problem += f"`{MATH_REQUIREMENT}`, `{more}`"
        return DomainError(problem, group.items[0].place, _MATH[head], code="math-functions")
    if len(group.items) == 1 and head[:1].isdigit():
        return _foreign("a number is written without parentheses", group.place, head)
    return None


def in_form(node: Node, form: Form, declared: Declared) -> DomainError | None:
    """Recognise a condition or an effect of another language, and a missing `and`."""
    if isinstance(node, Word):
        return _bare(node, form.what, declared)
    return (
        _infix(node, form.infix, declared)
        or _with_truth(node, form, declared)
        or _other_word(node, form, declared)
        or _missing_and(node, f"{form.what.split()[1]}s")
        or _misspelt(node, form.words, declared)
    )


def _bare(word: Word, what: str, declared: Declared) -> DomainError | None:
    """Recognise the name of a predicate without its parentheses."""
    declaration = declared.get(word.text)
    if declaration is None or declaration.numeric or declaration.parameters:
        return None
    problem = f"expected {what} in parentheses, found `{word.text}`"
    return _foreign(problem, word.place, f"({word.place.text})")


def swapped(group: Group, problem: str, place: Place, code: str) -> DomainError:
    """Return the error of a form of two parts that stand the wrong way round."""
    first, second = (node.place for node in group.items[1:3])
    text = place.source.text
    edits = (
        Edit(first.start, first.end, text[second.start : second.end]),
        Edit(second.start, second.end, text[first.start : first.end]),
    )
    return DomainError(problem, place, "swap the two", fix=Fix(edits), code=code)


def several(problem: str, nodes: Sequence[Node]) -> DomainError:
    """Return the error of several forms where one is taken."""
    first, last = nodes[0].place, nodes[-1].place
    place = first.source.place(first.start, last.end)
    return DomainError(problem, place, "put several under `and`", write=_under_and(nodes))


def several_after(group: Group, at: int, problem: str) -> DomainError:
    """Return the error of a form whose items from one position on have to be one."""
    if len(group.items) <= at + 1 or any(isinstance(node, Word) for node in group.items[1:]):
        return DomainError(problem, group.place)
    return several(problem, group.items[at:])


def written(node: Node) -> str:
    """Return a form as it is written, in one line and without comments."""
    if isinstance(node, Group):
        return f"({' '.join(written(item) for item in node.items)})"
    return node.place.text


def _infix(group: Group, words: Mapping[str, str], declared: Declared) -> DomainError | None:
    """Recognise `(x < 3)` and `(x = x + 1)`."""
    if len(group.items) not in (3, 5):
        return None
    left, middle, *right = group.items
    if not isinstance(middle, Word):
        return None
    if group.head in declared and len(declared[group.head].parameters) == len(group.items) - 1:
        return None  # an object may be called `or`
    if middle.text not in words or (isinstance(left, Word) and left.text in words):
        return None
    operand = _operand(right[0], declared)
    if len(right) == 3:
        operator = right[1]
        if middle.text in _ARITHMETIC or written(operator) not in _ARITHMETIC:
            return None
        operand = _prefix(written(operator), (right[0], right[2]), declared)
    return _foreign(
        f"`{middle.text}` stands between its operands",
        group.place,
        _applied(words[middle.text], f"{_operand(left, declared)} {operand}"),
        "in PDDL the operator comes first",
    )


def _other_word(group: Group, form: Form, declared: Declared) -> DomainError | None:
    """Recognise a word of other languages at the beginning."""
    head = group.head
    if head in declared or head not in form.other or len(group.items) == 1:
        return None
    write = _prefix(form.other[head], group.items[1:], declared)
    return _foreign(f"`{head}` is not supported in {form.what}", group.place, write)


def _misspelt(group: Group, words: Sequence[str], declared: Declared) -> DomainError | None:
    """Recognise a word of PDDL that is misspelt, before anything that can stand behind it."""
    head = group.head
    if head in declared or head in words or not any(isinstance(n, Group) for n in group.items):
        return None
    if not get_close_matches(head, words, n=1, cutoff=0.7):  # there are few, but many names
        return None
    close = get_close_matches(head, [*words, *declared], n=1, cutoff=0.7)
    if close[0] not in words:
        return None
    return _foreign(f"`{head}` is not a PDDL keyword", group.items[0].place, close[0])


def _prefix(word: str, operands: Sequence[Node], declared: Declared) -> str:
    return _applied(word, " ".join(_operand(node, declared) for node in operands))


def _applied(word: str, operands: str) -> str:
    return f"(not (= {operands}))" if word == "not =" else f"({word} {operands})"


def _operand(node: Node, declared: Declared) -> str:
    text = written(node)
    if isinstance(node, Word):
        if node.text in declared and not declared[node.text].parameters:
            return f"({text})"
        return _COMMA.sub(r"\1.\2", text)
    return text


def _with_truth(group: Group, form: Form, declared: Declared) -> DomainError | None:
    """Recognise `(= (held) true)`, which is `(held)`."""
    if group.head not in form.compares or group.head in declared or len(group.items) != 3:
        return None
    left, right = group.items[1:]
    name = left.head if isinstance(left, Group) else left.text
    if not isinstance(right, Word) or right.text not in _TRUTH:
        return None
    if name not in declared or declared[name].numeric:
        return None
    atom = written(left) if isinstance(left, Group) else f"({name})"
    write = atom if _TRUTH[right.text] else f"(not {atom})"
    return _foreign(f"a predicate alone is already {form.what}", group.place, write)


def _missing_and(group: Group, what: str) -> DomainError | None:
    if not group.items or any(isinstance(node, Word) for node in group.items):
        return None
    if len(group.items) > 1:
        problem = f"{what} are listed without `and`"
        return DomainError(problem, group.place, write=_under_and(group.items))
    return DomainError(
        "one pair of parentheses too many",
        group.place,
        write=written(group.items[0]),
        code="unbalanced-parentheses",
    )


def _under_and(nodes: Sequence[Node]) -> str:
    """Join forms under one `and`; those that are conjunctions give their parts."""
    parts: list[str] = []
    for node in nodes:
        inner = node.items[1:] if isinstance(node, Group) and node.head == "and" else (node,)
        parts += map(written, inner)
    return f"(and {' '.join(parts)})"
