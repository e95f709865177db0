"""Nothing of a file but its structure reaches the generated code."""

from __future__ import annotations

import ast
import re
from random import Random
from typing import get_args

import numpy as np
import pytest

from serp.model.codegen import Generated, Part, generate_code
from serp.model.ground import GroundModel
from serp.model.program import load_function
from tests.generated import FULL, PLANNABLE, Texts, generate, load_texts

OWN_NAMES = re.compile(
    r"(step|flow|action|drift|settle|judged_action|judged_aftermath|s|a|n|flags|theta|dt|out|trace|reward|unsafe|terminal|again"
    r"|fired\d+|kind\d+|t\d+)"
)
OWN_NODES = (
    *(ast.Module, ast.FunctionDef, ast.arguments, ast.arg, ast.Assign, ast.If, ast.While),
    *(ast.Return, ast.Pass, ast.Name, ast.Load, ast.Store, ast.Constant, ast.Subscript),
    *(ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp),
    *(
        ast.Add,
        ast.Sub,
        ast.Mult,
        ast.Div,
        ast.BitOr,
        ast.BitAnd,
        ast.USub,
        ast.Not,
        ast.And,
        ast.Or,
    ),
    *(ast.Lt, ast.LtE, ast.Eq, ast.NotEq, ast.GtE, ast.Gt),
)


def check_own_code(generated: Generated) -> None:
    """Only the generator's names, plain arithmetic, and no call but the trace's."""
    for node in ast.walk(generated.tree):
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.FunctionDef(name=name):
                assert OWN_NAMES.fullmatch(name), name
            case ast.Constant(value=value):
                assert type(value) in (bool, int, float)
            case ast.Expr(value=ast.Call(func=function, args=[ast.Constant()], keywords=[])):
                assert generated.sites and ast.unparse(function) == "trace.append"
            case ast.Call(func=ast.Attribute(ast.Name("trace"), "append")):
                pass
            case ast.Attribute(ast.Name("trace"), "append"):
                pass
            case _:
                assert isinstance(node, OWN_NODES), node


def all_generated(ground: GroundModel) -> list[Generated]:
    actions = range(len(ground.actions))
    return [
        generate_code(ground, part, action, traced=traced)
        for part in get_args(Part)
        for action in (actions if part in ("action", "judged_action") else [-1])
        for traced in (False, True)
    ]


@pytest.mark.parametrize("block", range(4))
def test_generated_code_has_names_of_its_own_only(block: int) -> None:
    for seed in range(40):
        random = Random(f"names {block}/{seed}")
        for generated in all_generated(generate(random, PLANNABLE if block else FULL).model.ground):
            check_own_code(generated)


WORDS = (
    *(
        "class",
        "lambda",
        "import",
        "def",
        "return",
        "while",
        "none",
        "true",
        "exec",
        "eval",
        "open",
    ),
    *("print", "s", "a", "n", "theta", "dt", "out", "trace", "append", "step", "judge", "again"),
    *("fired0", "kind0", "t0", "t1", "self", "numba", "os", "x__import__", "a--b", "z-_9"),
)


@pytest.mark.parametrize("word", WORDS)
def test_words_of_programs_are_ordinary_names(word: str) -> None:
    model = load_texts(
        Texts(
            f"(define (domain {word}) (:types {word}t) (:constants {word}o - {word}t)"
            f" (:predicates ({word} ?{word} - {word}t)) (:functions ({word}f))"
            f" (:action {word} :parameters (?{word} - {word}t) :precondition (not ({word} ?{word}))"
            f"  :effect (and ({word} ?{word}) (increase ({word}f) 0.5)))"
            f" (:process {word}p :effect (increase ({word}f) (* #t 2)))"
            f" (:event {word}e :precondition (> ({word}f) 1) :effect (assign ({word}f) 7)))",
            None,
        )
    ).model
    for generated in all_generated(model.ground):
        check_own_code(generated)
    assert model.step(np.zeros(2), f"{word} {word}o").state.tolist() == [1.0, 7.0]


def test_code_depends_on_structure_alone_not_on_names_or_numbers() -> None:
    def listing(name: str, number: str) -> str:
        texts = Texts(
            f"(define (domain d) (:functions ({name}))"
            f" (:action {name} :effect (increase ({name}) {number})))",
            None,
        )
        return ast.dump(generate_code(load_texts(texts).model.ground).tree)

    assert listing("x", "1") == listing("class", "-2.5e3")


def test_a_literal_is_read_from_theta_and_never_written_into_the_code() -> None:
    texts = Texts(
        "(define (domain d) (:functions (x)) (:action a :precondition (< (x) 12.5)"
        " :effect (assign (x) (* 12.5 (x)))))",
        None,
    )
    ground = load_texts(texts).model.ground
    constants = [
        node.value
        for node in ast.walk(generate_code(ground).tree)
        if isinstance(node, ast.Constant)
    ]
    assert 12.5 not in constants
    assert [parameter.value for parameter in ground.parameters] == [12.5, 12.5]


def test_the_loaded_function_reaches_no_builtins() -> None:
    model = generate(Random(1)).model
    function = load_function(generate_code(model.ground), "<step>")
    assert function.__globals__["__builtins__"] == {}
    assert set(function.__globals__) == {"__builtins__", "__name__", "step"}
