"""The model of a run, read from its folder without the environment."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp._util.saved_state import Saved
from serp.adaptation.adaptation import ModelAdaptation
from serp.errors import RunError
from serp.model.loading import Domain, load_domain
from serp.model.transition_model import TransitionModel
from serp.runs.checkpoint import NEWEST, PREVIOUS, Checkpoint
from serp.runs.folder import RunFolder
from serp.runs.recording import Recording, open_recording
from serp.settings import Settings
from serp.training.run_metadata import read_run_metadata, refuse_changes


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
