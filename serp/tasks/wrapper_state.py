"""The state that the layers of an environment keep from one episode to the next.

A layer is a wrapper, or the environment itself. Each episode begins with `reset(seed=...)`, so most
layers keep nothing. The state of the others is saved with a run, so that the run can be continued
exactly. It is one of these:

* the state of a layer that has `state_dict()` and `load_state_dict(state)` with JSON values;
* of other layers the attributes that are running statistics (objects with `mean`, `var` and
  `count`, as of gymnasium's NormalizeObservation and NormalizeReward) or NumPy random generators,
  and the arrays of gymnasium's own wrappers, of which some survive a reset.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

from serp._util.saved_state import state_for

_WATCHED = 5  # episodes: enough that no value is equal before and after all resets by chance
_LARGEST = 10_000  # largest size of a watched array


def layers_of(env: gym.Env[Any, Any]) -> list[Any]:
    """Return the wrappers of an environment, outermost first, and then the environment itself."""
    found: list[Any] = [env]
    while isinstance(found[-1], gym.Wrapper):
        found.append(found[-1].env)
    return found


def save(env: gym.Env[Any, Any]) -> dict[str, Any]:
    """Return the state as JSON values: `own` states of layers, and `found` attributes."""
    return {
        "own": [layer.state_dict() for layer in layers_of(env) if _saves_itself(layer)],
        "found": [[part.name, part.save()] for part in _parts(env)],
    }


def restore(env: gym.Env[Any, Any], saved: Mapping[str, Any]) -> None:
    """Restore what `save` returned.

    Raises:
        ValueError: The environment has other layers than the saved one; the message names them.
    """
    own = [layer for layer in layers_of(env) if _saves_itself(layer)]
    if len(own) != len(saved["own"]):
        raise ValueError(
            f"the saved one has {len(saved['own'])} layers with a state_dict(), this one {len(own)}"
        )
    for layer, state in zip(own, saved["own"], strict=True):
        layer.load_state_dict(state)
    _restore_found(env, saved, lambda part: True)


def restore_statistics(env: gym.Env[Any, Any], saved: Mapping[str, Any]) -> None:
    """Restore only the running statistics, which the scale of observations depends on.

    Raises:
        ValueError: As `restore`.
    """
    _restore_found(env, saved, lambda part: part.kind == "statistics")


@dataclass(frozen=True)
class _Part:
    """An attribute of a layer that is saved."""

    layer: Any
    name: str
    kind: str

    @property
    def value(self) -> Any:
        return getattr(self.layer, self.name)

    def save(self) -> dict[str, Any]:
        if self.kind == "generator":
            return {"kind": self.kind, "state": _as_lists(self.value.bit_generator.state)}
        if self.kind == "statistics":
            numbers = {name: _array(getattr(self.value, name)) for name in _STATISTICS}
            return {"kind": self.kind, **numbers}
        return {"kind": self.kind, "array": _array(self.value)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        if self.kind == "generator":
            self.value.bit_generator.state = state_for(self.value, saved["state"])
        elif self.kind == "statistics":
            for name in _STATISTICS:
                setattr(self.value, name, self._fitting(saved[name], getattr(self.value, name)))
        else:
            setattr(self.layer, self.name, self._fitting(saved["array"], self.value))

    def _fitting(self, saved: Mapping[str, Any], current: Any) -> Any:
        if tuple(saved["shape"]) != np.shape(current):
            raise ValueError(
                f"`{self.name}` of {type(self.layer).__name__} has shape {np.shape(current)}, the "
                f"saved one {tuple(saved['shape'])}"
            )
        kind = np.dtype(saved["dtype"])  # an update may have changed it
        if kind.kind not in "biuf":
            raise ValueError(
                f"`{self.name}` is saved as {saved['dtype']}, which is not a numeric type"
            )
        array = np.array(saved["values"], dtype=kind).reshape(saved["shape"])
        return array if isinstance(current, np.ndarray) else array[()].item()


_STATISTICS = ("mean", "var", "count")


def _restore_found(
    env: gym.Env[Any, Any], saved: Mapping[str, Any], wanted: Callable[[_Part], bool]
) -> None:
    here = list(_parts(env))
    for name, state in saved["found"]:
        part = next((p for p in here if (p.name, p.kind) == (name, state["kind"])), None)
        if part is not None:
            here.remove(part)
            if wanted(part):
                part.restore(state)
        elif state["kind"] != "generator":  # the first reset may make a generator
            raise ValueError(f"the saved one has a layer with `{name}`, this one has none")


def _parts(env: gym.Env[Any, Any]) -> Iterator[_Part]:
    for layer in layers_of(env):
        if _saves_itself(layer):
            continue
        for name, value in list(getattr(layer, "__dict__", {}).items()):
            # `reset(seed=...)` replaces Gymnasium's own generator.
            if isinstance(value, np.random.Generator) and value is not layer.np_random:
                yield _Part(layer, name, "generator")
            elif _is_statistics(value):
                yield _Part(layer, name, "statistics")
            elif _is_numeric(value) and _is_gymnasiums(layer):
                yield _Part(layer, name, "array")


def _saves_itself(layer: Any) -> bool:
    # A wrapper forwards unknown attributes, so ask its class.
    return all(hasattr(type(layer), name) for name in ("state_dict", "load_state_dict"))


def _is_gymnasiums(layer: Any) -> bool:
    return isinstance(layer, gym.Wrapper) and type(layer).__module__.startswith("gymnasium.")


def _is_numeric(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "biuf"


def _is_statistics(value: Any) -> bool:
    held = getattr(value, "__dict__", {})
    return (
        all(isinstance(held.get(name), float | int | np.ndarray | np.generic) for name in held)
        and all(name in held for name in _STATISTICS)
        and callable(getattr(value, "update", None))
    )


def _array(value: Any) -> dict[str, Any]:
    array = np.asarray(value)
    return {"dtype": array.dtype.str, "shape": list(array.shape), "values": array.ravel().tolist()}


def _as_lists(state: Any) -> Any:
    """Return a generator's state as JSON values; some kinds hold arrays."""
    if isinstance(state, Mapping):
        return {name: _as_lists(value) for name, value in state.items()}
    return state.tolist() if isinstance(state, np.ndarray | np.generic) else state


class UnsavedStateDetector:
    """Detects state that wrappers keep across resets and that is not saved.

    During the first episodes it compares the numbers, texts and arrays in the attributes of all
    wrappers that are not gymnasium's and have no `state_dict()`. An attribute that episodes change
    and resets do not is unsaved state.

    Args:
        env: The environment.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._wrappers = [
            layer
            for layer in layers_of(env)[:-1]
            if not _saves_itself(layer) and not _is_gymnasiums(layer)
        ]
        self._left = _WATCHED if self._wrappers else 0
        self._begun: dict[tuple[int, str], Any] | None = None
        self._ended: dict[tuple[int, str], Any] = {}
        self._changed: set[tuple[int, str]] = set()
        self._reset: set[tuple[int, str]] = set()

    def before_reset(self) -> None:
        """Record the attributes at the end of an episode."""
        if self._left and self._begun is not None:
            self._ended = self._look()
            self._changed |= _differences(self._begun, self._ended)

    def after_reset(self) -> list[str]:
        """Record the attributes at the beginning of the next episode.

        Returns:
            Once, after the first few episodes: the unsaved state, such as "Drifting keeps `drift`".
        """
        if not self._left:
            return []
        begins = self._look()
        if self._begun is not None:
            self._reset |= _differences(self._ended, begins)
            self._left -= 1
        self._begun = begins
        if self._left:
            return []
        carried = sorted(self._changed - self._reset)
        return [f"{type(self._wrappers[k]).__name__} keeps `{name}`" for k, name in carried]

    def _look(self) -> dict[tuple[int, str], Any]:
        return {
            (k, name): value.copy() if isinstance(value, np.ndarray) else value
            for k, wrapper in enumerate(self._wrappers)
            for name, value in getattr(wrapper, "__dict__", {}).items()
            if isinstance(value, bool | int | float | str | np.generic)
            or (_is_numeric(value) and value.size <= _LARGEST)
        }


def _differences(
    one: Mapping[tuple[int, str], Any], other: Mapping[tuple[int, str], Any]
) -> set[tuple[int, str]]:
    """Return the keys of both whose values differ (NaN equals NaN)."""
    return {
        key
        for key in one.keys() & other.keys()
        if not (one[key] is other[key] or _same(np.asarray(one[key]), np.asarray(other[key])))
    }


def _same(one: np.ndarray[Any, Any], other: np.ndarray[Any, Any]) -> bool:
    alike = one.dtype == other.dtype and one.shape == other.shape
    return alike and one.tobytes() == other.tobytes()
