"""What a training writes into its run folder while it goes on: steps, episodes, events."""

from __future__ import annotations

import contextlib

from serp._util.files import Closing
from serp.agent.step_record import StepRecord
from serp.runs.folder import RunFolder
from serp.runs.recording import RECORDING, Layout, Recorder
from serp.runs.tables import MetricsRow, decision_row
from serp.runs.tensorboard import EventWriter
from serp.settings import TrainingSettings
from serp.tasks.task import BoundTask


class RunLog(Closing):
    """Writes the steps and episodes of a training: tables, recording and TensorBoard events.

    A context manager; the folder stays open.

    Args:
        folder: The run, open for writing.
        task: The task.
        settings: They say whether steps are recorded and events are written.
        env_steps: Env steps that the run has made before; what was written of later ones is
            removed.
    """

    def __init__(
        self, folder: RunFolder, task: BoundTask, settings: TrainingSettings, env_steps: int = 0
    ) -> None:
        self._folder = folder
        self._name = task.actions.name
        self._recorder: Recorder | None = None
        self._events: EventWriter | None = None
        with contextlib.ExitStack() as stack:
            if settings.record:
                layout = Layout.of(task.model, task.actions)
                self._recorder = Recorder(folder.path / RECORDING, layout, env_steps)
                stack.enter_context(self._recorder)
            if settings.tensorboard:
                self._events = stack.enter_context(EventWriter(folder.path, env_steps + 1))
            self._open = stack.pop_all()

    def step(self, step: StepRecord, *, env_step: int, episode: int) -> None:
        """Write a step and its decision: `env_step` counts from 0, `episode` from 1."""
        row = decision_row(step.decision, self._name, step=env_step, episode=episode)
        self._folder.decisions.append(row)
        if self._recorder is not None:
            self._recorder.append(episode, step)

    def episode(self, row: MetricsRow) -> None:
        """Write the metrics of an episode."""
        self._folder.metrics.append(row)
        if self._events is not None:
            self._events.append(row)

    def flush(self) -> None:
        """Write what is buffered of the recording and the events."""
        if self._recorder is not None:
            self._recorder.flush()
        if self._events is not None:
            self._events.flush()

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self._open.close()
