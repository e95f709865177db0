"""The map from ground actions of the domain to actions of the environment."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.did_you_mean import did_you_mean
from serp._util.numbers import whole
from serp.errors import TaskError
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE, risk_of
from serp.model.transition_model import StateError, TransitionModel
from serp.planning.forecast import SAFE, Bound, Forecast, score_of
from serp.planning.preference import free_of_risk


class ActionForecast(NamedTuple):
    """The planner's `Forecast` for the E environment actions.

    Attributes:
        choice: The planner's action, best as in `Forecast`; -1 where no action is applicable.
        ground: `[E]` ground action that each environment action would execute (see `ActionMap`); -1
            where the model does not know it.
        value, path_risk, safe_steps, reward, flags: `[E]`. An action that the model does not know
            has value -inf, risk 0, safe steps SAFE, reward 0 and flags 0.
    """

    choice: int
    ground: NDArray[np.int64]
    value: NDArray[np.float64]
    path_risk: NDArray[np.float64]
    safe_steps: NDArray[np.int64]
    reward: NDArray[np.float64]
    flags: NDArray[np.int64]
    depth: int
    bound: Bound
    indifferent: bool

    @property
    def safe(self) -> NDArray[np.bool_]:
        """`[E]` whether the action is applicable, not flagged by the file, its risk accepted."""
        return free_of_risk(self.flags)

    @property
    def unflagged(self) -> NDArray[np.bool_]:
        """`[E]` whether the action is applicable and not flagged by the file."""
        unflagged: NDArray[np.bool_] = (self.flags & (APPLICABLE | UNSAFE)) == APPLICABLE
        return unflagged


class ActionMap:
    """The map from ground actions to the actions 0 ... E-1 of an environment.

    Several ground actions may share an environment action (`move a b` and `move b c` are both "go
    east"): the one whose precondition holds counts. If several hold, the worst counts: one that the
    file flags first, then one with an undefined result; else the largest risks, the shortest safe
    time, the least value and the least reward among them.

    Args:
        model: The transition model.
        size: Number of environment actions.
        mapping: Name of a ground action, or of a schema for all its other instances, →
            environment action. None: the n-th ground action is environment action n.

    Raises:
        TaskError: A ground action has no environment action, or a name or number does not exist.

    Attributes:
        environment_action: The environment action of every ground action.
        groups: The ground actions of every environment action.
        modelled: `[E]` whether an environment action has a ground action.
    """

    def __init__(
        self, model: TransitionModel, size: int, mapping: Mapping[str, int] | None = None
    ) -> None:
        self.model = model
        self.size = size
        self.environment_action = self._resolve(mapping)
        groups: list[list[int]] = [[] for _ in range(size)]
        for ground, action in enumerate(self.environment_action):
            groups[action].append(ground)
        self.groups = groups
        self.modelled = np.array([bool(group) for group in groups])
        self._all_modelled = all(groups)
        self._one_to_one = all(len(group) <= 1 for group in groups)
        self._first = np.array([group[0] if group else -1 for group in groups], dtype=np.int64)
        self._identity = bool((self._first == np.arange(size)).all()) and self._one_to_one

    def over(self, model: TransitionModel) -> ActionMap:
        """Return the same map for another model of the same ground actions."""
        other = copy.copy(self)
        other.model = model
        return other

    def _resolve(self, mapping: Mapping[str, int] | None) -> list[int]:
        model, size, count = self.model, self.size, len(self.model.actions)
        if mapping is None:
            if count > size:
                raise TaskError(
                    f"the domain has {count} ground actions, but the environment has {size}; give "
                    "the task `actions={name: number}` to map them"
                )
            return list(range(count))
        if not isinstance(mapping, Mapping):
            raise TaskError(f"actions must be a mapping {{name: number}}, not {mapping!r}")
        by_schema: dict[int, int] = {}
        by_name: dict[int, int] = {}
        schemas: dict[str, list[int]] = {}
        for index, ground in enumerate(model.actions):
            schemas.setdefault(ground.schema, []).append(index)
        for name, action in mapping.items():
            if whole(action, 0, size - 1) is None:
                raise TaskError(
                    f"actions: `{name}` is mapped to {action!r}, but the environment's actions "
                    f"are 0 to {size - 1}"
                )
            if name in schemas:
                by_schema.update((target, int(action)) for target in schemas[name])
                continue
            try:
                by_name[model.action_index(name)] = int(action)
            except StateError:
                known = [*schemas, *(a.name for a in model.actions)]
                raise TaskError(
                    f"actions: the domain has no action `{name}`; {did_you_mean(name, known)}"
                ) from None
        resolved = by_schema | by_name
        missing = [a.name for k, a in enumerate(model.actions) if k not in resolved]
        if missing:
            raise TaskError(
                f"actions: no environment action for `{missing[0]}`"
                + (f" and {len(missing) - 1} more" if len(missing) > 1 else "")
            )
        return [resolved[k] for k in range(count)]

    def name(self, action: int) -> str:
        """Return a printable name of an environment action."""
        group = [self.model.actions[k] for k in self.groups[action]]
        if len(group) == 1:
            return group[0].name
        return "/".join(dict.fromkeys(each.schema for each in group)) or f"action {action}"

    def project(self, forecast: Forecast) -> ActionForecast:
        """Return a forecast over ground actions as one over environment actions."""
        ground = self._first if self._one_to_one else self._choose(forecast)
        if not self._identity:
            forecast = self._projected(forecast, ground)
        return ActionForecast(forecast[0], ground, *forecast[1:], forecast.indifferent)

    def _projected(self, forecast: Forecast, ground: NDArray[np.int64]) -> Forecast:
        """Return a forecast for the environment actions, given the ground action of each."""
        choice = self.environment_action[forecast.choice] if forecast.choice >= 0 else -1
        columns: tuple[NDArray[Any], ...] = forecast[1:6]
        if not self._all_modelled:  # position -1 is that of the actions without a ground action
            unknown = -np.inf, 0.0, SAFE, 0.0, 0
            columns = tuple(map(np.append, columns, unknown))
        value, risk, steps, reward, flags = (column[ground] for column in columns)
        if not self._one_to_one:
            for action, group in enumerate(self.groups):
                together = [k for k in group if forecast.flags[k] & APPLICABLE]
                if len(together) > 1 and flags[action] & APPLICABLE:
                    value[action] = forecast.value[together].min()
                    risk[action] = forecast.path_risk[together].max()
                    steps[action] = forecast.safe_steps[together].min()
                    reward[action] = forecast.reward[together].min()
        projected = Forecast(choice, value, risk, steps, reward, flags, *forecast[-2:])
        if choice < 0 or self._one_to_one:
            return projected
        return projected._replace(choice=self._best(projected))

    def _best(self, of: Forecast) -> int:
        """Return the best action, of equal ones the first in the file; -1: none is applicable."""
        applicable = [a for a in range(self.size) if of.flags[a] & APPLICABLE]
        applicable.sort(key=lambda a: self.groups[a][0])
        return max(applicable, key=lambda a: score_of(of, a), default=-1)

    def _choose(self, forecast: Forecast) -> NDArray[np.int64]:
        """Return the ground action that counts for every environment action."""
        chosen = self._first.copy()
        flags: list[int] = forecast.flags.tolist()
        for action, group in enumerate(self.groups):
            possible = [k for k in group if flags[k]]
            if possible:
                chosen[action] = min(
                    possible,
                    key=lambda k: (
                        not flags[k] & UNSAFE,
                        not flags[k] & UNDEFINED,
                        -risk_of(flags[k]),
                        -forecast.path_risk[k],
                        forecast.safe_steps[k],
                        forecast.reward[k],
                    ),
                )
        return chosen
