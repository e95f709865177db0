"""Planning again what was recorded: a planner that makes the same choice."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.counterfactuals import Counterfactuals, counterfactuals
from serp.agent.veto import VetoPolicy
from serp.errors import RunError
from serp.model.domain import Domain, load_domain
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.far_sight import FarSightPlanner
from serp.planning.forecast import Bound, Forecast
from serp.planning.lookahead import Lookahead
from serp.runs.checkpoint import NEWEST, PREVIOUS, Checkpoint
from serp.runs.folder import RunFolder
from serp.runs.recording import Recording, StoredStep, open_recording
from serp.runs.run import read_run_metadata, refuse_changes
from serp.settings import Settings
from serp.tasks.action_map import ActionForecast, ActionMap


class RunModel:
    """The domain of a run and its model, as written and as adapted by the newest checkpoint.

    Args:
        run: The run's folder.

    Attributes:
        path: The run's folder.
        folder: Its files.
        settings: Its settings.
        domain: Its copy of the domain.
        model: The domain's transition model as written, with the task's control period.

    Raises:
        RunError: The folder is not a run, or its copy of the domain was changed.
        DomainError: Its copy of the domain is damaged.
    """

    def __init__(self, run: Path) -> None:
        self.path = run
        self.folder = RunFolder.open(run)
        made = read_run_metadata(self.folder)
        self.settings: Settings = made.settings
        if self.has_checkpoint:
            refuse_changes(self.folder, self.checkpoint, domain_only=True)
        domain = load_domain(
            *self.folder.copies(),
            observed=made.observed is not None,
            max_ground_schemas=made.max_ground_schemas,
        )
        if made.observed is not None:
            domain = domain.observed(made.observed)
        self.domain: Domain = domain
        self.model: TransitionModel = domain.model.replace(dt=made.control_period)

    @property
    def has_checkpoint(self) -> bool:
        """Whether the run has saved a checkpoint; one that another library drives has none."""
        return any((self.path / name).exists() for name in (NEWEST, PREVIOUS))

    @functools.cached_property
    def checkpoint(self) -> Checkpoint:
        """The newest intact checkpoint.

        Raises:
            RunError: There is none.
        """
        return self.folder.load_checkpoint()

    @functools.cached_property
    def adaptation(self) -> ModelAdaptation:
        """What the newest checkpoint has learned of the model.

        Raises:
            RunError: There is no intact checkpoint.
        """
        # Nothing is drawn after loading, so any seed will do.
        unused = np.random.SeedSequence(0)
        adaptation = ModelAdaptation(self.model, self.settings.adaptation, unused)
        adaptation.load_state_dict(*self._agent.part("adaptation"))
        return adaptation

    @property
    def saved_planner(self) -> tuple[Mapping[str, NDArray[Any]], Any]:
        """What the newest checkpoint has of the planner, for its `load_state_dict`."""
        return self._agent.part("planner")

    @property
    def _agent(self) -> Saved:
        whole = Saved("run", self.checkpoint.arrays, self.checkpoint.meta)
        return Saved("agent", self.checkpoint.arrays, whole.part("agent")[1])

    @property
    def adapted(self) -> TransitionModel | None:
        """The model of the newest checkpoint; None where nothing that was learned is in use."""
        if not self.has_checkpoint or self.adaptation.model.as_written:
            return None
        return self.adaptation.model

    def recording(self, evaluation: str | None = None) -> Recording:
        """Return the recorded steps of the training, or of an evaluation by its name.

        Raises:
            RunError: There are none, or they are of another domain.
        """
        found = open_recording(self.path, evaluation)
        layout = found.layout
        names = tuple(fluent.name for fluent in self.model.fluents)
        ground = tuple(action.name for action in self.model.actions)
        if (layout.fluents, layout.ground_actions) != (names, ground):
            raise RunError(
                f"{found.folder} does not fit the domain of the run: its fluents or actions have "
                "other names. Restore it from a copy."
            )
        return found


_SECONDS: Final = 4.0
"""Time that planning again may take, and the search for what would have had to differ."""


def agreeing_planner(run: RunModel, step: StoredStep) -> ChosenPlanner | None:
    """Return a planner that chooses what the planner of the run chose, or None.

    It plans with the file as written, or with what the newest checkpoint has learned. Of the two it
    is one that refuses the proposal that was refused, if there is one; then the one by which the
    choice is worth most nearly what was recorded. Where nothing was planned, it is the newest one.
    """
    forecast = step.decision.forecast
    if forecast.bound is Bound.SAFETY:
        return [*_candidates(run)][-1]
    if forecast.choice < 0:
        return None
    chosen = int(forecast.ground[forecast.choice])
    recorded = float(forecast.value[forecast.choice])
    refused = refusal_of(run, step)
    best, rank = None, (True, math.inf)
    for planner in _candidates(run):
        found = planner.forecast(step.state)
        allowed = refused is not None and not refused(found)
        own = allowed, abs(float(found.value[chosen]) - recorded)
        if found.choice == chosen and (best is None or own < rank):
            best, rank = planner, own
        if rank <= (False, 1e-9 * max(1.0, abs(recorded))):
            break
    return best


def planned_again(
    forecast: ActionForecast, planner: ChosenPlanner, state: Vector
) -> ActionForecast:
    """Return the forecast of a step in which only safety was checked, with a planner's plan."""
    found, ground = planner.forecast(state), forecast.ground
    chosen = np.flatnonzero((ground == found.choice) & (ground >= 0))

    def by_action(column: Vector, unknown: float) -> Vector:
        return np.where(ground >= 0, column[ground], unknown)

    return forecast._replace(
        choice=int(chosen[0]) if len(chosen) else -1,
        value=by_action(found.value, -np.inf),
        path_risk=by_action(found.path_risk, 0.0),
        depth=found.depth,
        bound=found.bound,
        indifferent=found.indifferent,
    )


def _candidates(run: RunModel) -> Iterator[ChosenPlanner]:
    settings = run.settings.planner
    make = FarSightPlanner if settings.name == "far-sight" else Lookahead
    written = make(run.model, settings)
    yield ChosenPlanner(written, run.model, settings, "the file as written", seconds=_SECONDS)
    if not run.has_checkpoint or (make is Lookahead and run.adapted is None):
        return
    model = run.adaptation.model
    planner = make(model, settings)
    if isinstance(planner, FarSightPlanner):
        planner.visited = run.adaptation.experience
        planner.load_state_dict(*run.saved_planner)
    learned = "what the newest checkpoint has learned"
    yield ChosenPlanner(planner, model, settings, learned, seconds=_SECONDS)


def refusal_of(run: RunModel, step: StoredStep) -> Callable[[Forecast], int] | None:
    """Return a function of a forecast: 1 where vetoes refuse the proposal of a step, else 0.

    None where no proposal was refused, or the domain does not mention it.
    """
    decision = step.decision
    ground = int(decision.forecast.ground[decision.proposed]) if decision.vetoed else -1
    if ground < 0:
        return None
    actions = ActionMap(run.model, len(run.model.actions))
    vetoes = VetoPolicy(actions, run.settings.arbiter)
    return lambda forecast: int(not vetoes.admissible(actions.project(forecast))[ground])


def other_vetoes_of(
    run: RunModel,
    step: StoredStep,
    planner: ChosenPlanner,
    ranges: tuple[Vector, Vector],
    whole: Collection[int],
) -> Counterfactuals | None:
    """Return the changes of one fluent with which the proposal of a step is not refused.

    `ranges` and `whole` are those of `counterfactuals`. None where none was refused, or none is
    refused today.
    """
    refused = refusal_of(run, step)
    if refused is None or not refused(planner.forecast(step.state)):
        return None
    return counterfactuals(
        lambda state: refused(planner.forecast(state)), run.model, step.state, ranges, whole=whole,
        called=("allowed", "refused").__getitem__, seconds=_SECONDS,
    )  # fmt: skip
