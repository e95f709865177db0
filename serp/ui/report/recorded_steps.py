"""The recorded steps that a report shows: some whole episodes, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.agent.decision import Reason
from serp.runs.recording import REASONS, VETO_COLUMNS, Recording, vetoed
from serp.runs.summary import Metrics, binned_shares, moving_interval, moving_mean

_NO_SAFE: Final = [REASONS.index(each) for each in (Reason.NO_SAFE_ACTION, Reason.LEAST_RISK)]


@dataclass(frozen=True)
class RecordedEpisode:
    """One recorded episode, by its number, from 1, in the order in which episodes begin.

    Attributes:
        positions: Positions `[n]` of its steps in the recording.
        return_: Sum of the environment's rewards.
        vetoes: Number of proposals refused.
        no_safe_action: Number of steps without an action predicted safe.
        end: `terminated`, `truncated`, or `unfinished` where the recording ends before.
        first: Its first row among the steps that are shown.
    """

    number: int
    positions: NDArray[np.int64]
    return_: float
    vetoes: int
    no_safe_action: int
    end: str
    first: int = 0

    def __len__(self) -> int:
        return len(self.positions)

    @property
    def rows(self) -> slice:
        """Its rows among the steps that are shown."""
        return slice(self.first, self.first + len(self))


@dataclass(frozen=True)
class RecordedSteps:
    """Steps of some episodes, `[N, ...]` in the order of `episodes`, with columns of a recording.

    `positions` are those in the recording; `no_safe` tells where no action was predicted safe.
    """

    episodes: tuple[RecordedEpisode, ...]
    positions: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]
    vetoed: NDArray[np.bool_]
    no_safe: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.positions)

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def place_of(self, step: int) -> str:
        """Return `episode 3, step 12`; steps count from 0."""
        episode = next(each for each in self.episodes if step < each.rows.stop)
        return f"episode {episode.number}, step {step - episode.first}"


def by_interest(episodes: Sequence[RecordedEpisode]) -> list[RecordedEpisode]:
    """Return episodes, first those that somebody wants to see: the last, the best, the worst.

    Then those in which no action was safe, those with vetoes, and the others, the latest first.
    """
    latest = sorted(episodes, key=lambda each: -each.number)
    if not latest:
        return []
    by_return = sorted(latest, key=lambda each: each.return_)
    rest = sorted(latest, key=lambda each: (not each.no_safe_action, not each.vetoes))
    first = (latest[0], by_return[-1], by_return[0])
    return list({each.number: each for each in (*first, *rest)}.values())


def recorded_steps(recording: Recording, most: int) -> RecordedSteps:
    """Return the steps of as many episodes as fit into a number of steps, see `by_interest`.

    If not even one fits, its last steps are left out.
    """
    everything = recording.columns(
        *VETO_COLUMNS, "state", "action", "executed_by", "proposed", "ground", "value", "path_risk",
        "safe_steps", "reward", "flags", "indifferent", "bound", "unsafe", "next_state",
        "env_reward", "terminated", "truncated",
    )  # fmt: skip
    refused, no_safe = vetoed(everything), np.isin(everything["reason"], _NO_SAFE)
    episodes = []
    for number, steps in sorted(recording.episodes.items()):
        ends = [name for name in ("terminated", "truncated") if everything[name][steps[-1]]]
        episodes.append(
            RecordedEpisode(
                number=number,
                positions=steps,
                return_=float(everything["env_reward"][steps].sum()),
                vetoes=int(refused[steps].sum()),
                no_safe_action=int(no_safe[steps].sum()),
                end=ends[0] if ends else "unfinished",
            )
        )
    chosen: list[RecordedEpisode] = []
    room = most
    for episode in by_interest(episodes):
        if not chosen and len(episode) > room:
            shown = episode.positions[:room]
            episode = replace(episode, positions=shown, end="not shown to its end")
        if len(episode) <= room:
            chosen.append(episode)
            room -= len(episode)
    chosen.sort(key=lambda each: each.number)
    firsts = np.cumsum([0, *map(len, chosen)]).tolist()
    rows = np.concatenate([np.zeros(0, np.int64), *(each.positions for each in chosen)])
    columns = {name: column[rows] for name, column in everything.items()}
    return RecordedSteps(
        episodes=tuple(replace(each, first=k) for each, k in zip(chosen, firsts, strict=False)),
        positions=rows,
        columns=columns,
        vetoed=refused[rows],
        no_safe=no_safe[rows],
    )


def curve_arrays(metrics: Metrics) -> dict[str, NDArray[Any]]:
    """Return what the page draws: the returns, their moving mean with its interval, the shares."""
    returns, count = metrics["return"], len(metrics["return"])
    drawn = np.unique(np.linspace(0, max(0, count - 1), min(count, 2_000)).astype(np.int64))
    mean, (low, high) = moving_mean(returns), moving_interval(returns)
    at, shares = binned_shares(metrics)
    return {
        "curveAt": metrics["env_steps"][drawn],
        "curveReturns": returns[drawn],
        "curveNumbers": metrics["episode"][drawn].astype(np.uint32),
        "mean": mean[drawn],
        "meanLow": low[drawn],
        "meanHigh": high[drawn],
        "rho": metrics["rho"][drawn],
        "shareAt": at,
        "shares": np.array(list(shares.values())),
    }
