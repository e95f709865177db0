"""The recorded steps of a run, to look at them with the file as it is edited."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from serp.runs.recording import VETO_COLUMNS, Recording, open_recording, vetoed
from serp.studio.played import PlayedEpisode, PlayedStep
from serp.studio.reading import Version
from serp.studio.shown_state import ShownState

_SAMPLE: Final = 500
"""Most states of a run that versions are compared on."""


class RecordedRun:
    """The recording of a run.

    Args:
        run: The folder of the run.
        version: The files as the run has them.

    Raises:
        RunError: It has no recording, or a part of that is damaged: what a page needs later is
            checked before there is one.
    """

    def __init__(self, run: Path, version: Version) -> None:
        self.run = run
        self.version = version
        self._recording: Recording = open_recording(run)
        self._recording.check()

    @functools.cached_property
    def vetoes(self) -> list[int]:
        """Positions of the steps in which a proposal was refused."""
        return np.flatnonzero(vetoed(self._recording.columns(*VETO_COLUMNS))).tolist()

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The least and greatest value of each fluent in the run."""
        if not len(self._recording):
            return {}
        low, high = self._recording.ranges
        names = self._recording.layout.fluents
        return dict(zip(names, zip(low.tolist(), high.tolist(), strict=True), strict=True))

    def next_veto(self, after: int) -> int | None:
        """Return the first step with a veto after a step; from the beginning where none follows."""
        return next((step for step in self.vetoes if step > after), next(iter(self.vetoes), None))

    def episode(self, number: int) -> PlayedEpisode:
        """Return an episode, from 1.

        Raises:
            RunError: There is none of that number.
        """
        self._recording.find(number, 1)
        steps = self._recording.episodes[number]
        name = f"episode {number} of {self.run.name}"
        return PlayedEpisode(tuple(self._steps(int(step) for step in steps)), name)

    def place_of(self, step: int) -> tuple[int, int]:
        """Return episode, from 1, and number in it, from 0, of a step."""
        found = self._recording.step(step)
        return found.episode, found.number - 1

    def sample(self) -> list[ShownState]:
        """Return states from all over the run."""
        count = len(self._recording)
        every = max(1, -(-count // _SAMPLE))
        names = self._recording.layout.fluents
        return [
            ShownState(
                dict(zip(names, self._recording.step(step).state.tolist(), strict=True)),
                f"run step {step}",
            )
            for step in range(0, count, every)
        ]

    def _steps(self, steps: Iterator[int]) -> Iterator[PlayedStep]:
        layout = self._recording.layout
        for step in steps:
            found = self._recording.step(step)
            decision = found.decision
            said = f"{decision.executed_by}: {layout.actions[decision.action]}"
            if decision.vetoed:
                proposed = (
                    layout.actions[decision.proposed] if decision.proposed >= 0 else "nothing"
                )
                said += f" instead of {proposed}: {decision.reason}"
            values = dict(zip(layout.fluents, found.state.tolist(), strict=True))
            yield PlayedStep(values, said, bool(decision.forecast.indifferent), "")
