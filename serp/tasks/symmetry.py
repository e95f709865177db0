"""Symmetries of a task, checked against the domain and against observations.

In a task with a symmetry every sample counts twice: what was learned on the left applies on the
right. A task declares which objects are exchanged and how the raw observation is mirrored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from serp._util.text import did_you_mean
from serp.errors import TaskError
from serp.learning.symmetry_group import Element, SymmetryGroup
from serp.model.flags import APPLICABLE, TERMINAL, UNSAFE
from serp.model.transition_model import StateError, TransitionModel, Vector

if TYPE_CHECKING:
    from serp.tasks.action_map import ActionMap
    from serp.tasks.task import BoundTask


@dataclass(frozen=True, kw_only=True)
class Symmetry:
    """A transformation that leaves a task unchanged, most often a reflection.

    Soccer, where everything on the left can happen on the right::

        Symmetry(objects={"left": "right"}, observation_signs=(1, -1, 1, ...))

    Cart-pole, whose fluents are positive to the right and change their signs::

        Symmetry(
            flip=("cart-position", "cart-velocity", "pole-angle", "pole-velocity"),
            actions={"push-left": "push-right"},
            observation_signs=(-1, -1, -1, -1),
        )

    A file without objects, whose sides are predicates and functions of different names::

        Symmetry(
            fluents={"ball-left": "ball-right", "room-left": "room-right"},
            actions={"go-left": "go-right"},
        )

    An incomplete mapping is completed to a permutation: `{"left": "right"}` exchanges both,
    `{"a": "b", "b": "c"}` maps c to a.

    Attributes:
        objects: Object of the domain → its image.
        fluents: Name of a predicate or function → that of its image, for all of their fluents. The
            arguments of a fluent are exchanged as `objects` says.
        flip: Numeric fluents that change their signs.
        actions: Ground action → its image, by name. Needed if it does not follow from `objects`; an
            action that is not named is its own image. An environment action that the domain does
            not mention is given by its number.
        observation_signs: Factor 1 or -1 of each entry of the mirrored observation; None: all are
            1.
        observation_order: For each entry of the mirrored observation, the index of the original
            entry; None: the same index. If both are None, the image of an observation is unknown,
            and only a learner whose input is the state uses the symmetry.
    """

    objects: Mapping[str, str] = field(default_factory=dict)
    fluents: Mapping[str, str] = field(default_factory=dict)
    flip: Sequence[str] = ()
    actions: Mapping[str | int, str | int] = field(default_factory=dict)
    observation_signs: Sequence[float] | None = None
    observation_order: Sequence[int] | None = None

    def __str__(self) -> str:
        mappings = (self.objects, self.fluents, self.actions)
        parts = [cycles(as_permutation(mapping)) for mapping in mappings]
        parts += [f"-{name}" for name in self.flip]
        return ", ".join(text for text in parts if text) or "of the observation only"


def as_permutation(mapping: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return a mapping completed to a permutation; a ValueError says why there is none."""
    if not isinstance(mapping, Mapping):
        raise ValueError(f"expected a mapping such as {{'left': 'right'}}, not {mapping!r}")
    whole = dict(mapping)
    sources = {image: source for source, image in mapping.items()}
    if len(sources) != len(mapping):
        twice = next(i for s, i in mapping.items() if sources[i] != s)
        raise ValueError(f"two things become `{twice}`")
    for end in mapping.values():
        if end not in mapping:
            start = end
            while start in sources:
                start = sources[start]
            whole[end] = start
    return whole


def cycles(mapping: Mapping[Any, Any]) -> str:
    """Return a permutation in words: `left <-> right, a -> b -> c -> a`."""
    told: list[str] = []
    seen: set[Any] = set()
    for start in mapping:
        if start in seen or mapping[start] == start:
            continue
        cycle = [start]
        while (following := mapping[cycle[-1]]) != start:
            cycle.append(following)
        seen.update(cycle)
        names = [str(name) for name in cycle]
        told.append(" <-> ".join(names) if len(cycle) == 2 else " -> ".join([*names, names[0]]))
    return ", ".join(told)


_TRANSITIONS = 4096
"""Number of predictions that are compared with those of their mirror images."""
_FLAGS = ((APPLICABLE, "applicable"), (UNSAFE, "unsafe"), (TERMINAL, "terminal"))
_TOLERANCE = 1e-6
"""Largest difference of two numbers that count as equal, relative to 1 or to their size."""


@dataclass(frozen=True)
class ModelSymmetry:
    """A symmetry of a domain: (σs)[i] = signs[i] · s[columns[i]], and σa = actions[a].

    Attributes:
        columns: A column of the state for each column.
        signs: 1.0 or -1.0 for each column.
        actions: The image of each ground action.
    """

    columns: tuple[int, ...]
    signs: tuple[float, ...]
    actions: tuple[int, ...]

    def of_state(self, state: Vector) -> Vector:
        """Return σs for a state `[F]`, or a batch `[..., F]`."""
        image: Vector = state[..., list(self.columns)] * np.array(self.signs)
        return image


def violation(model: TransitionModel, symmetry: ModelSymmetry) -> str | None:
    """Describe where a model contradicts a symmetry; None where it does not.

    Predictions in random states are compared with those in their mirror images, to float accuracy.
    The numbers are drawn near 0 and near the parameters, where conditions change.
    """
    rng = np.random.default_rng(0)
    count = len(model.actions)
    if not count:
        return None
    for state in _random_states(model, max(8, _TRANSITIONS // count), rng):
        image = symmetry.of_state(state)
        chosen = range(count)
        if count > _TRANSITIONS // 8:
            chosen = rng.choice(count, _TRANSITIONS // 8, replace=False).tolist()
        for action in chosen:
            found = _difference(model, symmetry, state, image, action)
            if found is not None:
                return found
    return None


def _random_states(model: TransitionModel, count: int, rng: np.random.Generator) -> Vector:
    numeric = np.array([fluent.numeric for fluent in model.fluents], dtype=np.bool_)
    shape = (count, len(numeric))
    scales = np.unique(np.abs(np.append(model.theta, 1.0)))
    # Continuous draws: exactly on a threshold, rounding would decide.
    near = rng.choice(scales, shape) * rng.uniform(0.5, 1.5, shape)
    numbers = np.where(rng.random(shape) < 0.5, near, rng.normal(size=shape))
    numbers *= rng.choice((-1.0, 1.0), shape)
    states: Vector = np.where(numeric, numbers, rng.integers(0, 2, shape))
    return states


def _difference(
    model: TransitionModel, symmetry: ModelSymmetry, state: Vector, image: Vector, action: int
) -> str | None:
    """Return a difference between the prediction of a step and that of its mirror image."""
    here, flags = model.transition(state.tolist(), action)
    there, image_flags = model.transition(image.tolist(), symmetry.actions[action])
    name, image_name = model.actions[action].name, model.actions[symmetry.actions[action]].name

    def differences() -> Iterator[str]:
        # Where a step has no result, its other flags may depend on the order of effects.
        both = flags & image_flags & APPLICABLE
        for bit, word in _FLAGS if both else _FLAGS[:1]:
            if (flags ^ image_flags) & bit:
                no = ("", "not ") if flags & bit else ("not ", "")
                yield f"`{name}` is {no[0]}{word}, `{image_name}` is {no[1]}{word}"
        if not both:
            return
        expected = symmetry.of_state(np.array(here[:-1]))
        for fluent, wanted, got in zip(model.fluents, expected.tolist(), there, strict=False):
            if not _same(wanted, got):
                yield (
                    f"after `{image_name}` the mirror image of `{name}` has "
                    f"`{fluent.name}` {wanted:.6g}, the domain predicts {got:.6g}"
                )
        if not _same(here[-1], there[-1]):
            yield f"`{name}` is worth {here[-1]:.6g}, `{image_name}` {there[-1]:.6g}"

    what = next(differences(), None)
    if what is None:
        return None
    shown = ", ".join(f"{k} {v:.4g}" for k, v in model.values(state).items())
    return f"{what}; seen from the state {shown} and its mirror image"


def _same(one: float, other: float) -> bool:
    return abs(one - other) <= _TOLERANCE * max(1.0, abs(one), abs(other))


_ADVICE = "correct the symmetry, take it out of the task, or set learner.symmetry to false"
_OBSERVED_TOLERANCE = 1e-4
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
        wrong = np.abs(expected - got) > _OBSERVED_TOLERANCE * np.maximum(1.0, np.abs(expected))
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


def symmetry_group(task: BoundTask, elements: Sequence[Element]) -> SymmetryGroup | None:
    """Return the symmetries of the learner's inputs and actions; None if there are none."""
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
