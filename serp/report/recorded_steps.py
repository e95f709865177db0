"""The recorded steps that a report shows: some whole episodes, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.control.decision import Reason
from serp.model.transition_model import Vector
from serp.runs.recording import (
    NEXT_STATE_COLUMNS,
    VETO_COLUMNS,
    Recording,
    next_states,
    vetoed,
)
from serp.runs.recording_format import REASONS

NO_SAFE: Final = (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK)
_SHOWN: Final = (
    "state", "action", "executed_by", "reason", "proposed", "proposed_by", "ground", "value",
    "path_risk", "safe_steps", "reward", "flags", "indifferent", "bound", "unsafe",
)  # fmt: skip


@dataclass(frozen=True)
class RecordedEpisode:
    """One recorded episode.

    Attributes:
        number: Its number, from 1, in the order in which episodes begin.
        positions: Positions `[n]` of its steps in the recording.
        return_: Sum of the environment's rewards.
        vetoes: Number of proposals refused.
        no_safe_action: Number of steps without an action predicted safe.
        end: How it ended: `terminated`, `truncated`, or `unfinished` where the recording ends
            before the episode.
        cut: Number of its last steps that the report leaves out.
    """

    number: int
    positions: NDArray[np.int64]
    return_: float
    vetoes: int
    no_safe_action: int
    end: str
    cut: int = 0

    def __len__(self) -> int:
        return len(self.positions)


@dataclass(frozen=True)
class RecordedSteps:
    """Steps of some episodes, each `[N, ...]` in the order of `episodes`.

    Attributes:
        episodes: The episodes, in the order in which they begin.
        columns: Columns of a recording.
        next_states: `[N, F]`; NaN where it was not recorded.
        ground: Ground action executed, -1 where the model does not know it.
        vetoed: Whether a proposal was refused.
        no_safe: Whether no action was predicted safe.
    """

    episodes: tuple[RecordedEpisode, ...]
    columns: dict[str, NDArray[Any]]
    next_states: Vector
    ground: NDArray[np.int64]
    vetoed: NDArray[np.bool_]
    no_safe: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.ground)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    @property
    def positions(self) -> NDArray[np.int64]:
        """`[N]` positions in the recording."""
        return np.concatenate([np.zeros(0, np.int64), *(each.positions for each in self.episodes)])

    @property
    def rows(self) -> list[slice]:
        """The rows of each episode."""
        ends = np.cumsum([len(each) for each in self.episodes]).tolist()
        return [slice(end - len(each), end) for each, end in zip(self.episodes, ends, strict=True)]

    def place_of(self, step: int) -> str:
        """Say where a step is: `episode 3, step 12`."""
        for episode, rows in zip(self.episodes, self.rows, strict=True):
            if step < rows.stop:
                return f"episode {episode.number}, step {step - rows.start + 1}"
        raise IndexError(step)


def recorded_episodes(recording: Recording) -> list[RecordedEpisode]:
    """Return all episodes of a recording, in the order in which they begin."""
    found = recording.columns("env_reward", *VETO_COLUMNS, "terminated", "truncated")
    refused = vetoed(found)
    unsafe = np.isin(found["reason"], [REASONS.index(reason) for reason in NO_SAFE])
    episodes = []
    for number, steps in sorted(recording.episodes.items()):
        last = steps[-1]
        ends = [name for name in ("terminated", "truncated") if found[name][last]]
        episodes.append(
            RecordedEpisode(
                number=number,
                positions=steps,
                return_=float(found["env_reward"][steps].sum()),
                vetoes=int(refused[steps].sum()),
                no_safe_action=int(unsafe[steps].sum()),
                end=ends[0] if ends else "unfinished",
            )
        )
    return episodes


def by_interest(episodes: Sequence[RecordedEpisode]) -> list[RecordedEpisode]:
    """Return episodes, first those that somebody wants to see: the last, the best, the worst.

    Then those in which no action was safe, those with vetoes, and the others, the latest first.
    """
    latest = sorted(episodes, key=lambda each: -each.number)
    if not latest:
        return []
    first = [
        latest[0],
        max(latest, key=lambda each: each.return_),
        min(latest, key=lambda each: each.return_),
    ]
    rest = sorted(latest, key=lambda each: (not each.no_safe_action, not each.vetoes))
    return list({each.number: each for each in (*first, *rest)}.values())


def chosen_steps(
    recording: Recording, episodes: Sequence[RecordedEpisode], most: int
) -> RecordedSteps:
    """Return the steps of as many episodes as fit into a number of steps, see `by_interest`.

    If not even one fits, it is cut.
    """
    chosen: list[RecordedEpisode] = []
    room = most
    for episode in by_interest(episodes):
        if len(episode) <= room:
            chosen.append(episode)
            room -= len(episode)
        elif not chosen:
            kept = episode.positions[:most]
            cut = len(episode) - most
            chosen.append(RecordedEpisode(**{**vars(episode), "positions": kept, "cut": cut}))
            break
    chosen.sort(key=lambda each: each.number)
    return _steps_of(recording, chosen)


def _steps_of(recording: Recording, episodes: list[RecordedEpisode]) -> RecordedSteps:
    everything = recording.columns(*dict.fromkeys((*_SHOWN, *NEXT_STATE_COLUMNS)))
    rows = np.concatenate([np.zeros(0, np.int64), *(each.positions for each in episodes)])
    columns = {name: everything[name][rows] for name in _SHOWN}
    chosen = columns["action"][:, None]
    return RecordedSteps(
        episodes=tuple(episodes),
        columns=columns,
        next_states=next_states(everything)[rows],
        ground=np.take_along_axis(columns["ground"], chosen, 1)[:, 0].astype(np.int64),
        vetoed=vetoed(columns),
        no_safe=np.isin(columns["reason"], [REASONS.index(reason) for reason in NO_SAFE]),
    )
