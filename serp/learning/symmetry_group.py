"""Symmetries of a learner's inputs and actions, as a group of signed permutations.

An element g of the group maps an input x to g·x and an action a to g·a, and a Q-function of a
symmetric task has Q(g·x, g·a) = Q(x, a). It has two uses: a sample in the replay memory represents
all its images, and the mean of Q over the group has that property exactly (van der Pol et al. 2020,
arXiv 2006.16908, build it into the network instead).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

MOST_ELEMENTS = 48
"""Most elements of a group: all permutations of four objects, and their mirror images."""
MOST_AVERAGED = 8
"""Most elements over which Q is averaged."""


@dataclass(frozen=True, slots=True)
class Element:
    """One signed permutation: (g·x)[i] = signs[i] · x[columns[i]], and g·a = actions[a].

    Attributes:
        columns: F columns, each once.
        signs: F numbers, each 1 or -1.
        actions: A actions, each once.

    Raises:
        ValueError: It is not a signed permutation.
    """

    columns: tuple[int, ...]
    signs: tuple[float, ...]
    actions: tuple[int, ...]

    def __post_init__(self) -> None:
        for numbers in (self.columns, self.actions):
            if sorted(numbers) != list(range(len(numbers))):
                raise ValueError(f"{numbers} is not a permutation")
        if len(self.signs) != len(self.columns) or not {1.0, -1.0}.issuperset(self.signs):
            raise ValueError(f"{self.signs} are not {len(self.columns)} signs")

    @staticmethod
    def identity(inputs: int, actions: int) -> Element:
        """Return the element that changes nothing."""
        return Element(tuple(range(inputs)), (1.0,) * inputs, tuple(range(actions)))

    def after(self, first: Element) -> Element:
        """Return the composition: first `first`, then this element."""
        return Element(
            tuple(first.columns[i] for i in self.columns),
            tuple(s * first.signs[i] for s, i in zip(self.signs, self.columns, strict=True)),
            tuple(self.actions[a] for a in first.actions),
        )

    def of_input(self, x: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return g·x of an input ``[..., F]``, of the same dtype."""
        image: npt.NDArray[Any] = x[..., list(self.columns)] * np.array(self.signs, x.dtype)
        return image

    def of_actions(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Permute values of actions ``[..., A]`` to the images of the actions."""
        image = np.empty_like(values)
        image[..., list(self.actions)] = values
        return image


class SymmetryGroup:
    """The group that signed permutations generate, up to a limit.

    A generator with which the group would be larger than `MOST_ELEMENTS` is left out. Q is
    averaged over a subgroup of at most `MOST_AVERAGED` elements, which come first.

    Args:
        inputs: Numbers in an input, F.
        actions: A.
        generators: The permutations, the most important first.

    Raises:
        ValueError: A generator has another size.

    Attributes:
        elements: The elements, the identity first.
        averaged: Number of elements over which Q is averaged.
        complete: Whether no generator was left out.
        columns, signs, actions: int64 ``[G, F]``, float32 ``[G, F]``, int64 ``[G, A]``.
    """

    def __init__(self, inputs: int, actions: int, generators: Iterable[Element] = ()) -> None:
        given = tuple(generators)
        for element in given:
            if len(element.columns) != inputs or len(element.actions) != actions:
                raise ValueError(
                    f"a symmetry of {len(element.columns)} inputs and {len(element.actions)} "
                    f"actions does not fit {inputs} and {actions}"
                )
        identity = Element.identity(inputs, actions)
        all_, taken = _closure(identity, given, MOST_ELEMENTS)
        few, _ = _closure(identity, taken, MOST_AVERAGED)
        subgroup = set(few)
        self.complete = set(given) <= set(all_)
        self.averaged = len(few)
        self.elements = (*few, *(e for e in all_ if e not in subgroup))
        self.columns = np.array([e.columns for e in self.elements], np.int64)
        self.signs = np.array([e.signs for e in self.elements], np.float32)
        self.actions = np.array([e.actions for e in self.elements], np.int64)

    def __len__(self) -> int:
        return len(self.elements)


def _closure(
    identity: Element, generators: Iterable[Element], most: int
) -> tuple[list[Element], list[Element]]:
    """Return the group of as many generators as fit, in a fixed order, and these generators."""
    group = [identity]
    taken: list[Element] = []
    for generator in generators:
        if generator not in group:
            larger = _generated(identity, [*taken, generator], most)
            if larger is not None:
                group = larger
                taken.append(generator)
    return group, taken


def _generated(identity: Element, generators: list[Element], most: int) -> list[Element] | None:
    """Return the group of some generators, breadth first; None if it exceeds `most`."""
    group, found = [identity], {identity}
    for element in group:  # grows during the loop
        for generator in generators:
            product = generator.after(element)
            if product not in found:
                if len(group) == most:
                    return None
                found.add(product)
                group.append(product)
    return group
