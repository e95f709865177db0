from __future__ import annotations

from dataclasses import replace

import pytest

from serp.model.domain import load_domain
from serp.model.transition_model import TransitionModel
from serp.tasks.registry import find_domain_file, load_task
from serp.tasks.symmetry import ModelSymmetry, cycles, violation
from tests.generated.models import load_texts
from tests.generated.writer import Texts

MIRROR = ModelSymmetry((0, 1, 2, 3), (-1.0, -1.0, -1.0, -1.0), (1, 0))


@pytest.fixture(scope="module")
def cartpole() -> TransitionModel:
    return load_task("cartpole").load().model.replace(dt=0.02)


@pytest.mark.parametrize("column", range(4))
def test_a_sign_left_out_is_found_out(cartpole: TransitionModel, column: int) -> None:
    signs = [-1.0] * 4
    signs[column] = 1.0
    assert violation(cartpole, replace(MIRROR, signs=tuple(signs))) is not None


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("(> (cart-position) 2.4)", "(> (cart-position) 2.3)", "safe|terminal"),
        ("(decrease (cart-velocity) 0.195)", "(decrease (cart-velocity) 0.190)", "cart-velocity"),
        ("(decrease (reward) (* 0.1 (cart-position)))", "(decrease (reward) (cart-position))",
         "is worth"),
        (":precondition (and)\n    :effect (and\n      (decrease (cart-velocity)",
         ":precondition (and (< (cart-position) 2))\n    :effect (and\n      "
         "(decrease (cart-velocity)", "applicable"),
    ],
)  # fmt: skip
def test_a_domain_edited_on_one_side_is_found_out(old: str, new: str, said: str) -> None:
    file = find_domain_file("cartpole")
    assert file is not None
    text = file.read_text(encoding="utf-8")
    assert violation(load_domain(file).model.replace(dt=0.02), MIRROR) is None
    edited = text.replace(old, new, 1)
    assert edited != text
    found = violation(load_texts(Texts(edited, None)).model.replace(dt=0.02), MIRROR)
    assert found is not None
    assert any(word in found for word in said.split("|"))
    assert "seen from the state cart-position" in found


def test_cycles_are_told_once_and_closed() -> None:
    assert cycles({"a": "b", "b": "a", "x": "x"}) == "a <-> b"
    assert cycles({"a": "b", "b": "c", "c": "a"}) == "a -> b -> c -> a"
    assert cycles({}) == ""
