"""Groups of signed permutations."""

from __future__ import annotations

from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.learning.symmetry_group import MOST_AVERAGED, MOST_ELEMENTS, Element, SymmetryGroup

F, A = 5, 4


@st.composite
def elements(draw: st.DrawFn) -> Element:
    return Element(
        tuple(draw(st.permutations(range(F)))),
        tuple(draw(st.lists(st.sampled_from((1.0, -1.0)), min_size=F, max_size=F))),
        tuple(draw(st.permutations(range(A)))),
    )


def cycle(length: int) -> Element:
    """Turns the first inputs, and three actions with them where that is a whole number of turns."""
    turned = tuple((i + 1) % length if i < length else i for i in range(F))
    return Element(turned, (1.0,) * F, (1, 2, 0, 3) if length == 3 else (0, 1, 2, 3))


MIRROR = Element((1, 0, 2, 3, 4), (1.0, 1.0, -1.0, 1.0, 1.0), (0, 2, 1, 3))
GROUPS = {
    "mirror": ([MIRROR], 2, 2),
    "turns": ([cycle(3)], 3, 3),
    "turns and mirror": ([cycle(4), Element((3, 2, 1, 0, 4), (1.0,) * F, (0, 1, 2, 3))], 8, 8),
    "large": ([cycle(4), Element((1, 0, 2, 3, 4), (1.0,) * F, (1, 0, 2, 3))], 48, 4),
}


@given(st.lists(elements(), max_size=3))
@settings(max_examples=50, deadline=None)
def test_a_group_is_one_and_so_is_what_q_is_averaged_over(generators: list[Element]) -> None:
    group = SymmetryGroup(F, A, generators)
    assert 1 <= group.averaged <= MOST_AVERAGED
    assert group.averaged <= len(group) <= MOST_ELEMENTS
    assert group.elements[0] == Element.identity(F, A)
    for part in (group.elements, group.elements[: group.averaged]):
        own = set(part)
        assert len(own) == len(part)
        assert all(one.after(other) in own for one, other in product(part, part))
    if group.complete:
        assert set(generators) <= set(group.elements)


@pytest.mark.parametrize("name", GROUPS)
def test_a_group_has_as_many_elements_as_fit(name: str) -> None:
    generators, size, averaged = GROUPS[name]
    group = SymmetryGroup(F, A, generators)
    assert (len(group), group.averaged, group.complete) == (size, averaged, True)


def test_a_generator_with_which_the_group_is_too_large_is_left_out() -> None:
    exchange = Element((1, 0, 2, 3, 4), (1.0,) * F, (0, 1, 2, 3))
    group = SymmetryGroup(F, A, [exchange, cycle(5)])  # all 120 permutations of five
    assert group.elements == (Element.identity(F, A), exchange)
    assert not group.complete


@pytest.mark.parametrize(
    "wrong",
    [
        ((0, 0), (1.0, 1.0), (0, 1)),
        ((0, 1), (1.0, 2.0), (0, 1)),
        ((0, 1), (1.0,), (0, 1)),
        ((0, 1), (1.0, 1.0), (1, 2)),
    ],
)
def test_what_is_no_signed_permutation_is_refused(wrong: Any) -> None:
    with pytest.raises(ValueError, match="permutation|signs"):
        Element(*wrong)


def test_a_generator_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="does not fit 3"):
        SymmetryGroup(3, A, [MIRROR])
