"""Symmetries of a task, checked against the domain and against observations.

In a task with a symmetry every sample counts twice: what was learned on the left applies on the
right. A task declares which objects are exchanged and how the raw observation is mirrored.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from serp._util.text import did_you_mean
from serp.errors import TaskError
from serp.learning.symmetry_group import Element, SymmetryGroup
from serp.model.transition_model import StateError, TransitionModel, Vector
from serp.tasks.declared_symmetry import Symmetry, as_permutation
from serp.tasks.model_symmetry import ModelSymmetry, violation

if TYPE_CHECKING:
    from serp.planning.action_map import ActionMap
    from serp.tasks.bound_task import BoundTask

_ADVICE = "correct the symmetry, take it out of the task, or set learner.symmetry to false"
_TOLERANCE = 1e-4
"""Relative tolerance, because observations are usually float32 and groundings compute with them."""


@dataclass(frozen=True)
class TaskSymmetry:
    """A declared symmetry, resolved for one task.

    Attributes:
        name: Description for messages.
        model: The symmetry of states and ground actions.
        actions: The image of every environment action.
        columns, signs: The symmetry of the flat observation; both None if it is not declared.
    """

    name: str
    model: ModelSymmetry
    actions: tuple[int, ...]
    columns: tuple[int, ...] | None
    signs: tuple[float, ...] | None

    def check_grounding(self, task: BoundTask, observation: Vector, state: Vector) -> None:
        """Check that grounding the mirror image of a flat observation gives that of its state.

        A grounding that takes more than the observation is not checked.
        """
        if self.columns is None or self.signs is None or task.grounding.takes:
            return
        mirrored = task.observations.raw(observation[list(self.columns)] * np.array(self.signs))
        expected, got = self.model.of_state(state), task.ground(mirrored)
        wrong = np.abs(expected - got) > _TOLERANCE * np.maximum(1.0, np.abs(expected))
        if wrong.any():
            k = int(wrong.argmax())
            raise TaskError(
                f"task {task.name}: symmetry {self.name}: an observation was mirrored, and its "
                f"grounding has `{task.model.fluents[k].name}` {got[k]:.6g} where the mirrored "
                f"state has {expected[k]:.6g}; the observation was {observation.tolist()}; "
                f"{_ADVICE}"
            )

    def element(self, inputs: str) -> Element | None:
        """Return the symmetry of the learner's input (`training.inputs`); None if unknown."""
        state = Element(self.model.columns, self.model.signs, self.actions)
        if inputs == "state":
            return state
        if self.columns is None or self.signs is None:
            return None
        if inputs == "observation":
            return Element(self.columns, self.signs, self.actions)
        width = len(self.columns)
        return Element(
            self.columns + tuple(width + c for c in state.columns),
            self.signs + state.signs,
            self.actions,
        )


def declared_symmetries(task: BoundTask) -> tuple[tuple[TaskSymmetry, ...], tuple[str, ...]]:
    """Return the symmetries that a task declares and its domain has.

    The expert may edit the domain file on one side only, which is not an error. A symmetry that the
    file does not have is left out; the second result has a line with the reason for each. A
    declaration that is wrong for every domain is a TaskError.
    """
    declared = task.task.symmetries
    if not isinstance(declared, Sequence) or not all(isinstance(s, Symmetry) for s in declared):
        raise TaskError(
            f"task {task.name}: symmetries must be a tuple of serp.Symmetry, not {declared!r}"
        )
    found, left_out = [], []
    for number, symmetry in enumerate(declared, 1):
        try:
            found.append(_resolve(task, symmetry))
        except _Unfit as error:
            left_out.append(f"The symmetry {symmetry} is not used: {error}")
        except ValueError as error:
            raise TaskError(
                f"task {task.name}: symmetry {number} ({symmetry!r}): {error}; {_ADVICE}"
            ) from None
    return tuple(found), tuple(left_out)


def symmetry_group(
    task: BoundTask, declared: Iterable[TaskSymmetry], inputs: str
) -> SymmetryGroup | None:
    """Return the symmetries of the learner's inputs and actions; None if there are none."""
    elements = [e for s in declared if (e := s.element(inputs)) is not None]
    if not elements:
        return None
    group = SymmetryGroup(len(elements[0].columns), task.actions.size, elements)
    return group if len(group) > 1 else None


class _Wrong(ValueError):
    """A declared symmetry is wrong for every domain."""


class _Unfit(_Wrong):
    """This domain file does not have a declared symmetry; another file may have it."""


def _resolve(task: BoundTask, symmetry: Symmetry) -> TaskSymmetry:
    objects, pairs = as_permutation(symmetry.objects), as_permutation(symmetry.actions)
    model = ModelSymmetry(
        _columns(task.model, objects, as_permutation(symmetry.fluents)),
        _signs(task.model, symmetry.flip),
        _ground_actions(task.model, objects, pairs),
    )
    contradiction = violation(task.model, model)
    if contradiction is not None:
        raise _Unfit(f"the domain contradicts it: {contradiction}")
    numbers = {a: b for a, b in pairs.items() if not isinstance(a, str)}
    actions = _environment_actions(task.actions, model, numbers)
    columns, signs = _of_observation(task.observation_size, symmetry)
    return TaskSymmetry(str(symmetry), model, actions, columns, signs)


def _columns(
    model: TransitionModel, objects: Mapping[str, str], symbols: Mapping[str, str]
) -> tuple[int, ...]:
    """Return the column whose value each column of the mirrored state has."""
    known = {o for fluent in model.fluents for o in fluent.arguments}
    known.update(o for action in model.actions for o in action.arguments)
    for name in objects:
        if name not in known:
            raise _Unfit(
                f"no fluent or action of the domain is about an object `{name}`; "
                f"{did_you_mean(str(name), known) or 'none is about any object'}"
            )
    numeric = {fluent.symbol: fluent.numeric for fluent in model.fluents}
    for name, image in symbols.items():
        if name not in numeric:
            raise _Unfit(
                f"no fluent of the domain is called `{name}`; {did_you_mean(str(name), numeric)}"
            )
        if numeric[name] and not numeric.get(image, True):
            raise _Unfit(f"function `{name}` and predicate `{image}` cannot be exchanged")
    place = {fluent.key: fluent.index for fluent in model.fluents}
    columns = [0] * len(place)
    for fluent in model.fluents:
        symbol = symbols.get(fluent.symbol, fluent.symbol)
        key = (symbol, *_exchanged(fluent.arguments, objects))
        if key not in place:
            raise _Unfit(
                f"fluent `{fluent.name}` has no mirror image, it would be `{' '.join(key)}`"
            )
        columns[place[key]] = fluent.index
    return tuple(columns)


def _signs(model: TransitionModel, flip: Sequence[str]) -> tuple[float, ...]:
    """Return the factor of each column of the mirrored state."""
    if isinstance(flip, str) or not isinstance(flip, Sequence):
        raise _Wrong(f"flip must be names of fluents, not {flip!r}")
    signs = [1.0] * len(model.fluents)
    index = {fluent.name: fluent for fluent in model.fluents}
    for name in flip:
        if name not in index:
            raise _Unfit(f"unknown fluent `{name}`; {did_you_mean(str(name), index)}")
        if not index[name].numeric:
            raise _Wrong(f"`{name}` is true or false and has no sign")
        signs[index[name].index] = -1.0
    return tuple(signs)


def _exchanged(arguments: tuple[str, ...], objects: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(objects.get(o, o) for o in arguments)


def _ground_actions(
    model: TransitionModel, objects: Mapping[str, str], pairs: Mapping[str | int, str | int]
) -> tuple[int, ...]:
    """Return the image of every ground action."""
    named = {(a.schema, a.arguments): k for k, a in enumerate(model.actions)}
    images = []
    for action in model.actions:
        image = named.get((action.schema, _exchanged(action.arguments, objects)))
        if image is None:
            raise _Unfit(f"action `{action.name}` has no mirror image")
        images.append(image)
    for name, to in pairs.items():
        if isinstance(name, str) != isinstance(to, str):
            raise _Wrong(f"actions: `{name}` and `{to}`: give both by name, or both by number")
        if isinstance(name, str) and isinstance(to, str):
            try:
                images[model.action_index(name)] = model.action_index(to)
            except StateError as error:
                raise _Unfit(f"actions: {error}") from None
    if len(set(images)) != len(images):
        twice = next(k for k in images if images.count(k) > 1)
        raise _Wrong(f"two actions become `{model.actions[twice].name}`")
    return tuple(images)


def _environment_actions(
    actions: ActionMap, model: ModelSymmetry, numbers: Mapping[Any, Any]
) -> tuple[int, ...]:
    """Return the image of every environment action."""
    images: list[int | None] = [None] * actions.size
    for ground, image in enumerate(model.actions):
        here, there = actions.environment_action[ground], actions.environment_action[image]
        if images[here] not in (None, there):
            raise _Unfit(
                f"`{actions.name(here)}` is one action of the environment with two mirror images"
            )
        images[here] = there
    for number, to in numbers.items():
        for action in (number, to):
            if (
                isinstance(action, bool)
                or not isinstance(action, int | np.integer)
                or not (0 <= action < actions.size)
            ):
                raise _Wrong(f"actions: the environment has no action {action!r}")
            if actions.modelled[action]:
                raise _Wrong(f"actions: call action {action} `{actions.name(int(action))}`")
        images[int(number)] = int(to)
    if None in images:
        missing = images.index(None)
        raise _Unfit(
            f"the domain does not mention the environment's action {missing}; say what it becomes, "
            f"as in actions={{{missing}: {missing}}}"
        )
    resolved = tuple(image for image in images if image is not None)
    if len(set(resolved)) != len(resolved):
        twice = next(a for a in resolved if resolved.count(a) > 1)
        raise _Wrong(f"two actions of the environment become `{actions.name(twice)}`")
    return resolved


def _of_observation(
    size: int, symmetry: Symmetry
) -> tuple[tuple[int, ...], tuple[float, ...]] | tuple[None, None]:
    order, signs = symmetry.observation_order, symmetry.observation_signs
    if order is None and signs is None:
        return None, None
    columns = _numbers(range(size) if order is None else order)
    if sorted(columns) != list(range(size)):
        raise _Wrong(f"observation_order must name each of the {size} places once, not {order!r}")
    factors = _numbers((1,) * size if signs is None else signs)
    if len(factors) != size or not {1.0, -1.0}.issuperset(factors):
        raise _Wrong(f"observation_signs must be {size} times 1 or -1, not {signs!r}")
    return tuple(int(c) for c in columns), factors


def _numbers(values: Any) -> tuple[float, ...]:
    """Return a sequence as numbers; empty if it is not one."""
    try:
        return tuple(float(value) for value in values)
    except (TypeError, ValueError):
        return ()
