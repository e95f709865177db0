"""Nothing of a file but its structure reaches the generated code."""

from __future__ import annotations

import ast
import re
from random import Random
from typing import get_args

import numpy as np
import pytest

from serp.model.codegen import MATH, Generated, Part, generate_code, load_function
from serp.model.ground_model import GroundModel
from tests.generated import FULL, PLANNABLE, Texts, generate, load_texts

OWN_NAMES = re.compile(
    r"(s|a|n|flags|theta|dt|out|trace|reward|unsafe|terminal|again|fired\d+|kind\d+|t\d+"
    rf"|{'|'.join(get_args(Part))})"
)
OWN_NODES = (
    *(ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Assign, ast.If, ast.While),
    *(ast.Return, ast.Pass, ast.Name, ast.Load, ast.Store, ast.Constant, ast.Subscript),
    *(ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Not, ast.And, ast.Or),
    *(ast.Add, ast.Sub, ast.Mult, ast.Div, ast.BitOr, ast.BitAnd, ast.USub),
    *(ast.Lt, ast.LtE, ast.Eq, ast.NotEq, ast.GtE, ast.Gt),
)


def check_own_code(ground: GroundModel) -> None:
    """Only the generator's names, arithmetic, and no call but of MATH and the trace's."""
    actions = range(len(ground.actions))
    for part in get_args(Part):
        for action in actions if part in ("action", "judged_action") else [-1]:
            for traced in (False, True):
                check_function(generate_code(ground, part, action, traced=traced))


def check_function(generated: Generated) -> None:
    for node in ast.walk(ast.parse(generated.text)):
        match node:
            case ast.Name(id=name, ctx=ast.Load()) if name in MATH:
                pass
            case ast.Name(id=name) | ast.arg(arg=name) | ast.FunctionDef(name=name):
                assert OWN_NAMES.fullmatch(name), name
            case ast.Constant(value=value):
                assert type(value) in (bool, int, float)
            case ast.Expr(ast.Call(function, [ast.Tuple([ast.Constant(), _, state])], [])):
                assert ast.unparse(function) == "trace.append" and ast.unparse(state) == "out[:]"
            case ast.Tuple() | ast.Slice():
                assert generated.sites, node
            case ast.Call(func=ast.Name(name), keywords=[]):
                assert name in MATH
            case ast.Call(func=ast.Attribute(ast.Name("trace"), "append")):
                pass
            case ast.Attribute(ast.Name("trace"), "append"):
                pass
            case _:
                assert isinstance(node, OWN_NODES), node


@pytest.mark.parametrize("flavour", [FULL, PLANNABLE])
def test_generated_code_has_names_of_its_own_only(flavour: object) -> None:
    for seed in range(25):
        check_own_code(generate(Random(f"names {seed}"), flavour).model.ground)  # type: ignore[arg-type]


WORDS = (
    *("class", "lambda", "import", "def", "return", "while", "none", "true", "exec", "eval"),
    *("open", "print", "s", "a", "n", "theta", "dt", "out", "trace", "append", "step", "judge"),
    *("again", "fired0", "kind0", "t0", "t1", "self", "numba", "os", "x__import__", "a--b", "z-_9"),
)


@pytest.mark.parametrize("word", WORDS)
def test_words_of_programs_are_ordinary_names(word: str) -> None:
    domain = (
        f"(define (domain {word}) (:types {word}t) (:constants {word}o - {word}t)"
        f" (:predicates ({word} ?{word} - {word}t)) (:functions ({word}f))"
        f" (:action {word} :parameters (?{word} - {word}t) :precondition (not ({word} ?{word}))"
        f"  :effect (and ({word} ?{word}) (increase ({word}f) 0.5)))"
        f" (:process {word}p :effect (increase ({word}f) (* #t 2)))"
        f" (:event {word}e :precondition (> ({word}f) 1) :effect (assign ({word}f) 7)))"
    )
    model = load_texts(Texts(domain, None)).model
    check_own_code(model.ground)
    assert model.step(np.zeros(2), f"{word} {word}o").state.tolist() == [1.0, 7.0]


def test_the_loaded_function_reaches_no_builtins() -> None:
    function = load_function(generate_code(generate(Random(1)).model.ground))
    assert function.__globals__["__builtins__"] == {}
    assert set(function.__globals__) == {"__builtins__", "__name__", "step", *MATH}
