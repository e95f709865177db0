"""The recorded steps that a report shows: some whole episodes, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.text import plural
from serp.agent.decision import Reason
from serp.errors import RunError, SerpError
from serp.model.transition_model import Vector
from serp.runs.evaluation import interval_of
from serp.runs.recording import (
    NEXT_STATE_COLUMNS,
    VETO_COLUMNS,
    Recording,
    evaluations_of,
    next_states,
    open_recording,
    vetoed,
)
from serp.runs.recording_format import REASONS
from serp.runs.run import Run
from serp.runs.summary import Metrics, binned_shares, moving_interval, moving_mean

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


_MOST: Final = 3_000
"""Most episodes that are drawn one by one; of more, evenly spread ones are."""
_POINTS: Final = 600
"""Most points of the mean."""


def curve_arrays(metrics: Metrics, recorded: Sequence[RecordedEpisode]) -> dict[str, NDArray[Any]]:
    """Return what the page draws: the returns, their moving mean with its interval, the shares.

    Args:
        metrics: The metrics, whose episodes are numbered as they end.
        recorded: The recorded episodes of the training, which are numbered as they begin.
    """
    ended = [each for each in recorded if each.end != "unfinished"]
    ended.sort(key=lambda each: int(each.positions[-1]))
    numbers = np.zeros(len(metrics["episode"]), np.uint32)  # 0: not recorded
    known = min(len(ended), len(numbers))
    numbers[:known] = [each.number for each in ended[:known]]
    steps, returns = metrics["env_steps"], metrics["return"]
    drawn, points = _spread(len(returns), _MOST), _spread(len(returns), _POINTS)
    mean, (low, high) = moving_mean(returns), moving_interval(returns)
    at, shares = binned_shares(metrics)
    return {
        "curveAt": steps[drawn],
        "curveReturns": returns[drawn],
        "curveNumbers": metrics["episode"][drawn].astype(np.uint32),
        "curveEpisodes": numbers[drawn],
        "meanAt": steps[points],
        "mean": mean[points],
        "meanLow": low[points],
        "meanHigh": high[points],
        "rho": np.nan_to_num(metrics["rho"])[points],
        "shareAt": at,
        "shares": np.array(list(shares.values())),
    }


def _spread(count: int, most: int) -> NDArray[np.int64]:
    """Return evenly spread positions, the first and the last among them."""
    return np.unique(np.linspace(0, max(0, count - 1), min(count, most)).astype(np.int64))


def planner_baseline(run: Run, episodes: int) -> tuple[dict[str, Any] | None, list[str]]:
    """Return the planner's mean return: `mean`, `low`, `high` and a `label`; and what was left out.

    It is that of the recorded evaluation with the most episodes; without one the planner is
    evaluated now, for some episodes (None if for 0). What cannot be read or evaluated is left out,
    for the rest of a report does not need it.
    """
    found: dict[str, list[float]] = {}
    notes: list[str] = []
    for name in evaluations_of(run.path):
        try:
            recording = open_recording(run.path, name)
            if recording.layout.policy == "planner":
                rewards = recording.columns("env_reward")["env_reward"]
                found[name] = [float(rewards[own].sum()) for own in recording.episodes.values()]
        except RunError as error:
            notes.append(f"The evaluation {name} was left out: {error}")
    best = max(found, key=lambda name: len(found[name]), default="")
    if best and found[best]:
        returns, origin = found[best], f"evaluation {best}"
    else:
        try:
            returns = list(run.evaluate("planner", episodes=episodes).returns) if episodes else []
        except SerpError as error:  # no checkpoint, or no environment
            returns = []
            notes.append(f"The planner alone was not evaluated: {error}")
        origin = "evaluated for this report"
    if not returns:
        return None, notes
    mean = float(np.mean(returns))
    low, high = interval_of(returns) or (mean, mean)
    count = plural(len(returns), "episode")
    label = f"the planner alone, mean of {count} with its 95 % interval ({origin})"
    return {"mean": mean, "low": low, "high": high, "label": label}, notes
