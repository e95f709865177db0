"""The recorded steps of a run or of an evaluation, read from its folder."""

from __future__ import annotations

import contextlib
import functools
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from serp._util.files import Closing, make_inside, write_durably
from serp._util.text import listed, plural
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import StepRecord
from serp.errors import Notice, RunError
from serp.model.transition_model import Vector
from serp.planning.edges import Bound
from serp.runs.folder import RunLock
from serp.runs.recording_format import (
    ACTORS,
    COLUMNS,
    EVALUATIONS,
    HEADER,
    REASONS,
    RECORDING,
    Columns,
    Layout,
    block_path,
    blocks_in,
    decode,
    encode,
    enter,
)
from serp.tasks.action_map import ActionForecast

VETO_COLUMNS: Final = ("proposed_by", "reason")
"""What `vetoed` is told by."""
NEXT_STATE_COLUMNS: Final = ("episode", "state", "terminated", "truncated", "final_state")
"""What `next_states` are among."""
_BOUNDS: Final = tuple(Bound)
_KEPT = 8
"""Blocks that are kept in memory."""


@dataclass(frozen=True)
class StoredStep:
    """One recorded step.

    Attributes:
        step: Its position in the recording, from 0: the `step` of `decisions.csv`.
        episode: Number of its episode, from 1, in the order in which they begin.
        number: Its number in the episode, from 1.
        state: State `[F]` before it.
        next_state: State `[F]` after it; None where the recording was stopped in the episode.
        decision: The decision, with all that was predicted.
        env_reward: The environment's reward.
        domain_reward: R(s′) of the domain file.
        unsafe: Whether the step came out unsafe, see `StepRecord.unsafe_observed`.
        terminated, truncated: Whether the episode ended, and how.
    """

    step: int
    episode: int
    number: int
    state: Vector
    next_state: Vector | None
    decision: Decision
    env_reward: float
    domain_reward: float
    unsafe: bool
    terminated: bool
    truncated: bool


class _Spread(NamedTuple):
    """Of every fluent `[F]`: extremes, whether it is whole, and its usual change."""

    low: Vector
    high: Vector
    whole: NDArray[np.bool_]
    change: Vector


class Recording:
    """The steps that a run, or an evaluation of it, recorded.

    Blocks are read when they are needed. A recording that is being written can be read, up to its
    last complete block or flush.

    Args:
        folder: The folder with `recording.json`.

    Attributes:
        layout: Names and sizes.

    Raises:
        RunError: There is no recording there, or it is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.layout = Layout.read(folder)
        blocks = list(blocks_in(folder).items())
        for number, (found, _) in enumerate(blocks):
            if number != found:
                raise RunError(f"{folder} has no block {number}. Restore it from a copy.")
        self._files = [file for _, file in blocks]
        last = len(decode(self._files[-1], self.layout, ["number"])["number"]) if blocks else 0
        self._steps = max(0, len(blocks) - 1) * self.layout.block + last
        self._block = functools.lru_cache(_KEPT)(self._read_block)

    def __len__(self) -> int:
        """Return the number of steps."""
        return self._steps

    def _read_block(self, number: int) -> Columns:
        found = decode(self._files[number], self.layout)
        self._require_full(number, found)
        return found

    def _require_full(self, number: int, found: Columns) -> None:
        if number < len(self._files) - 1 and len(found["number"]) != self.layout.block:
            raise RunError(f"{self._files[number]} has too few steps. Restore it from a copy.")

    def check(self) -> None:
        """Read every block once.

        Raises:
            RunError: One is damaged.
        """
        for number in range(len(self._files)):
            self._read_block(number)

    def columns(self, *names: str, since: int = 0) -> Columns:
        """Return columns of all steps: name → `[N, ...]`; see `serp.runs.recording_format`.

        Args:
            names: The columns.
            since: The first step, from 0; blocks before it are not read.
        """
        parts = []
        first, skipped = divmod(since, self.layout.block)
        wanted = dict.fromkeys(("number", "terminated", "truncated", *names))
        for number, file in enumerate(self._files[first:], first):
            found = decode(file, self.layout, wanted)
            self._require_full(number, found)
            if number == first and skipped:
                ended = int((found["terminated"] | found["truncated"])[:skipped].sum())
                found = {
                    name: values[ended if name == "final_state" else skipped :]
                    for name, values in found.items()
                }
            parts.append(found)
        empty = self.layout.empty(0)
        return {
            name: np.concatenate([empty[name], *(part[name] for part in parts)]) for name in names
        }

    @functools.cached_property
    def episodes(self) -> dict[int, NDArray[np.int64]]:
        """Number of an episode → its steps, in order. Episodes that run together interleave."""
        numbers = self.columns("episode")["episode"]
        order = np.argsort(numbers, kind="stable")
        names, starts = np.unique(numbers[order], return_index=True)
        return (
            dict(zip(names.tolist(), np.split(order, starts[1:]), strict=True))
            if len(order)
            else {}
        )

    @property
    def ranges(self) -> tuple[Vector, Vector]:
        """The smallest and the largest value `[F]` of every fluent, before all steps."""
        return self._spread.low, self._spread.high

    @property
    def whole(self) -> list[int]:
        """Positions of the fluents that have whole numbers in all states."""
        return np.flatnonzero(self._spread.whole).tolist()

    @property
    def usual_change(self) -> Vector:
        """The root mean square `[F]` of what a fluent changes by from one step to the next."""
        return self._spread.change

    @functools.cached_property
    def _spread(self) -> _Spread:
        """What is known of the states, block by block: all of them may not fit into memory."""
        width = len(self.layout.fluents)
        low, high = np.full(width, np.inf), np.full(width, -np.inf)
        whole, total, count = np.ones(width, dtype=np.bool_), np.zeros(width), 0
        before: dict[int, Vector] = {}
        for file in self._files:
            block = decode(file, self.layout, ["episode", "state", "terminated", "truncated"])
            states, episodes = block["state"], block["episode"]
            ended = block["terminated"] | block["truncated"]
            low, high = np.minimum(low, states.min(axis=0)), np.maximum(high, states.max(axis=0))
            whole &= (states == np.rint(states)).all(axis=0)
            for episode in np.unique(episodes).tolist():
                rows = np.flatnonzero(episodes == episode)
                own = states[rows]
                if episode in before:
                    own = np.vstack([before.pop(episode), own])
                if not ended[rows[-1]]:
                    before[episode] = own[-1]
                total += np.square(np.diff(own, axis=0)).sum(axis=0)
                count += len(own) - 1
        return _Spread(low, high, whole, np.sqrt(total / max(1, count)))

    def step(self, step: int) -> StoredStep:
        """Return a step by its position.

        Raises:
            RunError: There is no such step.
        """
        if not 0 <= step < len(self):
            there = f"steps 0 to {len(self) - 1:,}" if len(self) else "no steps yet"
            raise RunError(f"there is no step {step:,}: {self.folder} holds {there}.")
        block, row = divmod(step, self.layout.block)
        columns = self._block(block)

        def at(name: str) -> Any:
            value = columns[name][row]
            return value.copy() if isinstance(value, np.ndarray) else value.item()

        forecast = ActionForecast(
            choice=at("choice"),
            ground=at("ground").astype(np.int64),
            value=at("value"),
            path_risk=at("path_risk"),
            safe_steps=at("safe_steps").astype(np.int64),
            reward=at("reward"),
            flags=at("flags"),
            depth=at("depth"),
            bound=_BOUNDS[at("bound")],
            indifferent=at("indifferent"),
        )
        decision = Decision(
            action=at("action"),
            executed_by=ACTORS[at("executed_by")],
            reason=REASONS[at("reason")],
            proposed=at("proposed"),
            proposed_by=ACTORS[at("proposed_by")],
            rho=at("rho"),
            forecast=forecast,
            admissible=at("admissible"),
        )
        episode = at("episode")
        return StoredStep(
            step=step,
            episode=episode,
            number=at("number"),
            state=at("state"),
            next_state=self._next_state(step, episode, columns, row),
            decision=decision,
            env_reward=at("env_reward"),
            domain_reward=at("domain_reward"),
            unsafe=at("unsafe"),
            terminated=at("terminated"),
            truncated=at("truncated"),
        )

    def _next_state(self, step: int, episode: int, columns: Columns, row: int) -> Vector | None:
        ends = columns["terminated"] | columns["truncated"]
        if ends[row]:
            final: Vector = columns["final_state"][int(ends[:row].sum())].copy()
            return final
        steps = self.episodes[episode]
        following = int(np.searchsorted(steps, step)) + 1
        if following == len(steps):
            return None
        block, row = divmod(int(steps[following]), self.layout.block)
        state: Vector = self._block(block)["state"][row].copy()
        return state

    def find(self, episode: int, number: int) -> int:
        """Return the position of a step of an episode, both from 1.

        Raises:
            RunError: There is no such episode, or no such step in it.
        """
        steps = self.episodes.get(episode)
        if steps is None:
            last = max(self.episodes, default=0)
            there = f"episodes 1 to {last:,}" if last else "no episode yet"
            raise RunError(f"there is no episode {episode:,}: {self.folder} holds {there}.")
        if not 1 <= number <= len(steps):
            raise RunError(
                f"episode {episode:,} has no step {number:,}: it has "
                f"{plural(len(steps), 'step')}, counted from 1."
            )
        return int(steps[number - 1])


def vetoed(columns: Columns) -> NDArray[np.bool_]:
    """Return `[n]` whether a proposal was refused in each step, see `Decision.vetoed`.

    Args:
        columns: Those of `VETO_COLUMNS`.
    """
    by_planner = columns["proposed_by"] == ACTORS.index(Actor.PLANNER)
    accepted = columns["reason"] == REASONS.index(Reason.ACCEPTED)
    return np.asarray(~(by_planner | accepted))


def next_states(columns: Columns) -> Vector:
    """Return the states `[n, F]` after steps; NaN where they are not among the columns.

    Args:
        columns: Those of `NEXT_STATE_COLUMNS`, in the order of a recording.
    """
    episodes, found = columns["episode"], np.full_like(columns["state"], np.nan)
    order = np.argsort(episodes, kind="stable")  # episodes that run together interleave
    goes_on = np.diff(episodes[order]) == 0
    found[order[:-1][goes_on]] = columns["state"][order[1:][goes_on]]
    found[columns["terminated"] | columns["truncated"]] = columns["final_state"]
    return found


def open_recording(run: Path, evaluation: str | None = None) -> Recording:
    """Open the recording of a run, or of one of its evaluations.

    Args:
        run: The folder of the run.
        evaluation: The name of the evaluation, such as `serp-seed0`; None: that of the training.

    Raises:
        RunError: There is none.
    """
    if evaluation is not None:
        found = evaluations_of(run)
        if evaluation not in found:
            there = f"there are {listed(found)}" if found else "`serp evaluate` makes one"
            raise RunError(f"{run} has no evaluation `{evaluation}`; {there}.")
        return Recording(run / EVALUATIONS / evaluation)
    if not (run / RECORDING / HEADER).is_file():
        there = "".join(f"\n  serp why {run} --evaluation {name}" for name in evaluations_of(run))
        raise RunError(
            f"{run} has no recording of its steps. A run trained with training.record=true, which "
            "is the default, has one; `serp evaluate` records its episodes."
            + (f" There are evaluations:{there}" if there else "")
        )
    return Recording(run / RECORDING)


def evaluations_of(run: Path) -> list[str]:
    """Return the names of the recorded evaluations of a run."""
    folder = run / EVALUATIONS
    if not folder.is_dir():
        return []
    return sorted(each.name for each in folder.iterdir() if (each / HEADER).is_file())


@contextlib.contextmanager
def recorded_evaluation(run: Path, name: str, layout: Layout) -> Iterator[Recorder | None]:
    """Yield the recorder of an evaluation of a run, in place of an earlier one of that name.

    Where the folder of the run cannot be written, nothing is recorded, and a notice says so.

    Args:
        run: The folder of the run.
        name: Name of the evaluation, such as `serp-seed0`.
        layout: What is recorded.
    """
    with contextlib.ExitStack() as stack:
        recorder: Recorder | None = None
        try:
            folder = make_inside(run, EVALUATIONS, name)
            stack.callback(RunLock(folder).release)
            recorder = stack.enter_context(Recorder(folder, layout))
        except (RunError, OSError) as error:
            warnings.warn(f"the episodes are not recorded: {error}", Notice, stacklevel=3)
        yield recorder


class Recorder(Closing):
    """Writes the steps of a recording, one after another. A context manager.

    Steps are written where a block is full, at `flush` and at `close`. Only the last block is ever
    written again.

    Args:
        folder: The folder of the recording; it is made.
        layout: What is recorded.
        steps: Steps to keep of what has been recorded there; the rest is removed.

    Raises:
        RunError: There are fewer steps, they are of another layout, or the disk fails.
    """

    def __init__(self, folder: Path, layout: Layout, steps: int = 0) -> None:
        make_inside(folder.parent, folder.name)
        self._folder = folder
        self._layout = layout
        self._number, rest = divmod(steps, layout.block)
        self._columns: Columns = layout.empty(layout.block)
        self._final = np.zeros((layout.block, len(layout.fluents)))
        self._ends = self._rows = 0
        self._written = True
        if steps:
            self._keep(steps)
        for number, file in blocks_in(folder).items():
            if number > self._number or (number == self._number and not rest):
                file.unlink()
        write_durably(folder / HEADER, layout.text())

    def _keep(self, steps: int) -> None:
        """Take over the steps that are there."""
        number, row = divmod(steps - 1, self._layout.block)
        rows = row + 1
        if Layout.read(self._folder) != self._layout:
            raise RunError(
                f"{self._folder / HEADER} is not of this run: names or sizes differ. Restore it "
                "from a copy, or begin a new run with another --out."
            )
        there = blocks_in(self._folder)
        last = decode(there[number], self._layout) if number in there else None
        found = 0 if last is None else len(last["number"])
        if sum(k < number for k in there) < number or last is None or found < rows:
            raise RunError(
                f"{self._folder} does not hold the {steps:,} steps that the run has made: blocks "
                "are missing. Restore them from a copy, or begin a new run with another --out."
            )
        if rows == self._layout.block:
            return
        ends = (last["terminated"] | last["truncated"])[:rows]
        self._ends, self._rows = int(ends.sum()), rows
        self._final[: self._ends] = last.pop("final_state")[: self._ends]
        for name, values in last.items():
            self._columns[name][:rows] = values[:rows]

    def append(self, episode: int, step: StepRecord) -> None:
        """Add a step; nothing of it is kept that may change afterwards.

        Args:
            episode: Number of the episode, from 1.
            step: The step.
        """
        enter(self._columns, self._rows, episode, step)
        if step.last:
            self._final[self._ends] = step.next_state
            self._ends += 1
        self._rows += 1
        self._written = False
        if self._rows == self._layout.block:
            self.flush()
            self._number, self._rows, self._ends = self._number + 1, 0, 0

    def flush(self) -> None:
        """Write the steps of the last block."""
        if self._written:
            return
        last = {
            name: self._columns[name][: self._rows] for name in COLUMNS if name != "final_state"
        }
        last["final_state"] = self._final[: self._ends]
        write_durably(block_path(self._folder, self._number), encode(last))
        self._written = True

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self.flush()
