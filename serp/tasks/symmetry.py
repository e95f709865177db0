"""The mirror image of a task: what a task declares, resolved for the learner, and checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from serp.errors import TaskError
from serp.learning.reflection import Reflection
from serp.model.transition_model import Vector

if TYPE_CHECKING:
    from serp.tasks.task import BoundTask


@dataclass(frozen=True, kw_only=True)
class Symmetry:
    """A reflection that leaves a task unchanged, such as left for right.

    Soccer, where everything on the left can happen on the right::

        Symmetry(objects={"left": "right"}, observation_signs=(1, -1, 1, ...))

    Cart-pole, whose fluents are positive to the right and change their signs::

        Symmetry(
            flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
            actions={"push-left": "push-right"},
            observation_signs=(-1, -1, -1, -1),
        )

    Attributes:
        objects: Objects of the domain that are exchanged.
        flip: Numeric fluents that change their signs, by name. Those that the file does not have
            are left out, so that variants of the file have the same symmetry.
        actions: Environment actions that are exchanged, by number or by the name of a ground action
            of the domain. Each other one is its own mirror image, or that which `objects` says.
        observation_signs: Factor 1 or -1 of each number of the flat observation; None: all 1.
        observation_order: For each number of the mirrored observation, the place of the original
            one; None: the same place.
    """

    objects: Mapping[str, str] = field(default_factory=dict)
    flip: Sequence[str] = ()
    actions: Mapping[str | int, str | int] = field(default_factory=dict)
    observation_signs: Sequence[float] | None = None
    observation_order: Sequence[int] | None = None


class _Missing(Exception):
    """The domain file does not have what the symmetry names; another file may have it."""


def resolved(task: BoundTask) -> tuple[Reflection | None, str | None]:
    """Return the reflection of the learner's inputs: observation and state; None where none.

    The second result says why a declared symmetry does not fit the domain file.

    Raises:
        TaskError: The declaration is wrong for every domain file.
    """
    symmetry = task.task.symmetry
    if symmetry is None:
        return None, None
    try:
        if not isinstance(symmetry, Symmetry):
            raise ValueError("it must be a serp.Symmetry")
        size = task.observation_size
        order = symmetry.observation_order
        order = list(range(size)) if order is None else [int(place) for place in order]
        signs = symmetry.observation_signs
        signs = [1.0] * size if signs is None else [float(sign) for sign in signs]
        if len(order) != size or len(signs) != size:
            raise ValueError(f"an observation has {size} numbers, not {len(order)}, {len(signs)}")
        objects = _both_ways(symmetry.objects)
        columns = [size + column for column in _columns(task, objects)]
        flips = [-1.0 if f.name in symmetry.flip else 1.0 for f in task.model.fluents]
        actions = _actions(task, objects, _both_ways(symmetry.actions))
        return Reflection(order + columns, signs + flips, actions), None
    except _Missing as error:
        return None, f"the symmetry of the task is not used: {error}"
    except (TypeError, ValueError) as error:
        raise TaskError(f"task {task.name}: symmetry {symmetry!r}: {error}") from None


def _both_ways(pairs: Mapping[Any, Any]) -> dict[Any, Any]:
    return {**pairs, **{image: name for name, image in pairs.items()}}


def _columns(task: BoundTask, objects: Mapping[str, str]) -> list[int]:
    """Return for each fluent the one that it is exchanged with."""
    place = {fluent.key: fluent.index for fluent in task.model.fluents}
    columns = []
    for fluent in task.model.fluents:
        key = (fluent.symbol, *(objects.get(name, name) for name in fluent.arguments))
        if key not in place:
            raise _Missing(f"fluent `{fluent.name}` has no mirror image `{' '.join(key)}`")
        columns.append(place[key])
    return columns


def _actions(
    task: BoundTask, objects: Mapping[str, str], exchanged: Mapping[Any, Any]
) -> list[int]:
    """Return for each environment action the one that it is exchanged with."""
    actions, ground = task.actions, task.model.actions
    number = {action.name: actions.environment_action[k] for k, action in enumerate(ground)}
    for name in exchanged:
        if isinstance(name, str) and name not in number:
            raise _Missing(f"the domain has no action `{name}`")
        if not isinstance(name, str) and not 0 <= name < actions.size:
            raise ValueError(f"the environment has no action {name!r}")
    images = list(range(actions.size))
    instances = {(a.schema, *a.arguments): number[a.name] for a in ground}
    for action in ground:
        key = (action.schema, *(objects.get(name, name) for name in action.arguments))
        if key not in instances:
            raise _Missing(f"action `{action.name}` has no mirror image `{' '.join(key)}`")
        images[number[action.name]] = instances[key]
    for name, image in exchanged.items():
        images[number.get(name, name)] = number.get(image, image)
    return images


def check_grounding(
    task: BoundTask, reflection: Reflection, observation: Vector, state: Vector
) -> None:
    """Check that the mirror image of a flat observation is grounded as that of its state.

    Nothing is checked where the observation is not one array, or the grounding takes more than it.

    Raises:
        TaskError: They differ.
    """
    space = task.env.observation_space
    if task.grounding.takes or not isinstance(space, gym.spaces.Box):
        return
    mirrored = reflection.of_inputs(np.concatenate((observation, state)))
    size = len(observation)
    got = task.ground(mirrored[:size].reshape(space.shape).astype(space.dtype))
    # Relative, because observations are usually float32.
    wrong = np.abs(mirrored[size:] - got) > 1e-4 * np.maximum(1.0, np.abs(got))
    if wrong.any():
        k = int(wrong.argmax())
        raise TaskError(
            f"task {task.name}: symmetry: the mirror image of the observation "
            f"{observation.tolist()} has `{task.model.fluents[k].name}` {got[k]:g}, and the mirror "
            f"image of its state has {mirrored[size + k]:g}; correct the task's `symmetry`, or "
            "leave it out"
        )
