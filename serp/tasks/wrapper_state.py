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

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import gymnasium as gym
import numpy as np

from serp._util.files import finite
from serp._util.saved_state import state_for

_STATISTICS: Final = ("mean", "var", "count")


def save(env: gym.Env[Any, Any]) -> dict[str, Any]:
    """Return the state as JSON values: `own` states of layers, and `found` attributes."""
    return {
        "own": [layer.state_dict() for layer in _layers_of(env) if _saves_itself(layer)],
        "found": [[part.name, {"kind": part.kind, **part.save()}] for part in _parts(env)],
    }


def restore(
    env: gym.Env[Any, Any], saved: Mapping[str, Any], *, statistics_only: bool = False
) -> None:
    """Restore what `save` returned, or only the running statistics; a ValueError if unlike."""
    if not statistics_only:
        own = [layer for layer in _layers_of(env) if _saves_itself(layer)]
        if len(own) != len(saved["own"]):
            layers = f"{len(saved['own'])} wrappers with a state_dict()"
            raise ValueError(f"the saved environment has {layers}, this one has {len(own)}")
        for layer, state in zip(own, saved["own"], strict=True):
            layer.load_state_dict(state)
    here = list(_parts(env))
    for name, state in saved["found"]:
        part = next((p for p in here if (p.name, p.kind) == (name, state["kind"])), None)
        if part is not None:
            here.remove(part)
            if part.kind == "statistics" or not statistics_only:
                part.restore(state)
        elif state["kind"] != "generator":  # the first reset may make a generator
            raise ValueError(f"only the saved environment has a wrapper with `{name}`")


def has_statistics(env: gym.Env[Any, Any]) -> bool:
    """Return whether a layer keeps running statistics that `save` finds."""
    return any(part.kind == "statistics" for part in _parts(env))


class _Part(NamedTuple):
    """An attribute of a layer that is saved."""

    layer: Any
    name: str
    kind: str

    @property
    def value(self) -> Any:
        return getattr(self.layer, self.name)

    def save(self) -> dict[str, Any]:
        if self.kind == "generator":
            return {"state": finite(self.value.bit_generator.state)}  # some kinds hold arrays
        if self.kind == "statistics":
            return {name: _array(getattr(self.value, name)) for name in _STATISTICS}
        return {"array": _array(self.value)}

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
                f"`{self.name}` of {type(self.layer).__name__} has shape {np.shape(current)}, "
                f"but the saved array has {tuple(saved['shape'])}"
            )
        dtype = np.dtype(saved["dtype"])  # an update may have changed it
        if dtype.kind not in "biuf":
            raise ValueError(f"`{self.name}` is saved as {dtype}, which is not a numeric type")
        array = np.array(saved["values"], dtype=dtype).reshape(saved["shape"])
        return array if isinstance(current, np.ndarray) else array[()].item()


def _parts(env: gym.Env[Any, Any]) -> Iterator[_Part]:
    for layer in _layers_of(env):
        if _saves_itself(layer):
            continue
        home = type(layer).__module__
        gymnasiums = isinstance(layer, gym.Wrapper) and home.startswith("gymnasium.")
        for name, value in list(getattr(layer, "__dict__", {}).items()):
            # `reset(seed=...)` replaces Gymnasium's own generator.
            if isinstance(value, np.random.Generator) and value is not layer.np_random:
                yield _Part(layer, name, "generator")
            elif _is_statistics(value):
                yield _Part(layer, name, "statistics")
            elif gymnasiums and isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
                yield _Part(layer, name, "array")


def _layers_of(env: gym.Env[Any, Any]) -> list[Any]:
    """Return the wrappers of an environment, outermost first, and then the environment itself."""
    layers: list[Any] = [env]
    while isinstance(layers[-1], gym.Wrapper):
        layers.append(layers[-1].env)
    return layers


def _saves_itself(layer: Any) -> bool:
    # A wrapper forwards unknown attributes, so ask its class.
    return all(hasattr(type(layer), name) for name in ("state_dict", "load_state_dict"))


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
