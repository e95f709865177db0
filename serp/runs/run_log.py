"""What a training writes into its run folder while it goes on: steps and episodes."""

from __future__ import annotations

from serp._util.files import Closing
from serp.agent.step_record import StepRecord
from serp.runs.folder import RunFolder
from serp.runs.recording import RECORDING, Layout, Recorder
from serp.runs.tables import MetricsRow, decision_row
from serp.tasks.task import BoundTask


class RunLog(Closing):
    """Writes the steps and episodes of a training: tables and recording.

    A context manager; the folder stays open.

    Args:
        folder: The run, open for writing.
        task: The task.
        env_steps: Env steps that the run has made before; what was recorded of later ones is
            removed.
    """

    def __init__(self, folder: RunFolder, task: BoundTask, env_steps: int = 0) -> None:
        self._folder = folder
        self._name = task.actions.name
        layout = Layout.of(task.model, task.actions)
        self._recorder = Recorder(folder.path / RECORDING, layout, env_steps)

    def step(self, step: StepRecord, *, env_step: int, episode: int) -> None:
        """Write a step and its decision: `env_step` counts from 0, `episode` from 1."""
        row = decision_row(step.decision, self._name, step=env_step, episode=episode)
        self._folder.decisions.append(row)
        self._recorder.append(episode, step)

    def episode(self, row: MetricsRow) -> None:
        """Write the metrics of an episode."""
        self._folder.metrics.append(row)

    def flush(self) -> None:
        """Write what is buffered of the recording."""
        self._recorder.flush()

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self._recorder.close()
