"""The steps of a run, or of an evaluation of it: written while it goes on, read from its folder.

``recording.json``     names and sizes, see `Layout`
``block-000000.npz``   the columns of the first `Layout.block` steps, and so on

A block is an ordinary compressed `.npz` file (``numpy.load(file, allow_pickle=False)``), a column
an array of it. The bits of a block depend on its content alone. What is read is checked: names,
types, shapes, and the range of every number that something is looked up by.
"""

from __future__ import annotations

import functools
import io
import json
import re
import zipfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from serp._util.did_you_mean import listed
from serp._util.files import (
    Closing,
    existing_inside,
    json_text,
    make_inside,
    read_json,
    read_regular,
    write_durably,
)
from serp._util.text import plural
from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import StepRecord
from serp.errors import RunError
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import SAFE, Bound
from serp.settings import first_of
from serp.tasks.action_map import ActionForecast, ActionMap

RECORDING: Final = "recording"
EVALUATIONS: Final = "evaluations"
HEADER: Final = "recording.json"
ACTORS: Final = tuple(Actor)
REASONS: Final = tuple(Reason)
Columns = dict[str, NDArray[Any]]
"""Name of a column → values `[n]`, `[n, F]` or `[n, E]` of n steps."""
VETO_COLUMNS: Final = ("proposed_by", "reason")

_BLOCK_STEPS: Final = 1024
_NAME: Final = re.compile(r"block-(\d{6,9})\.npz")
_AGAIN: Final = "Restore it from a copy; metrics.csv and decisions.csv can still be read."

_HUGE: Final = float(np.finfo(np.float64).max)
_SUMMED: Final = 1e280  # the sum over a recording is finite, too


class _Column(NamedTuple):
    """A column of a block."""

    kind: str
    per: str  # what a step has an entry for: `F` fluents, `E` actions of the environment, or one
    of: str  # attribute of a `StepRecord`; empty if it is none
    low: float = -_HUGE
    high: float | str = _HUGE  # or the list of the layout in which it holds positions
    nothing: bool = False  # whether it may hold NaN, for none


_COLUMNS: Final[Mapping[str, _Column]] = {
    "episode": _Column("<i4", "", "", 1),
    "number": _Column("<i4", "", "number", 1),
    "state": _Column("<f8", "F", "state"),
    "action": _Column("<i4", "", "decision.action", 0, "actions"),
    "executed_by": _Column("|u1", "", "decision.executed_by", 0, "actors"),
    "reason": _Column("|u1", "", "decision.reason", 0, "reasons"),
    "proposed": _Column("<i4", "", "decision.proposed", -1, "actions"),
    "proposed_by": _Column("|u1", "", "decision.proposed_by", 0, "actors"),
    "rho": _Column("<f8", "", "decision.rho", 0.0, 1.0, nothing=True),
    "choice": _Column("<i4", "", "decision.forecast.choice", -1, "actions"),
    "depth": _Column("<i4", "", "decision.forecast.depth", 0),
    "bound": _Column("|u1", "", "decision.forecast.bound", 0, "bounds"),
    "indifferent": _Column("|b1", "", "decision.indifferent", 0, 1),
    "ground": _Column("<i4", "E", "decision.forecast.ground", -1, "ground_actions"),
    "value": _Column("<f8", "E", "decision.forecast.value", -np.inf, np.inf, nothing=True),
    "path_risk": _Column("<f8", "E", "decision.forecast.path_risk", 0.0, 1.0),
    "safe_steps": _Column("<i4", "E", "decision.forecast.safe_steps", -1, SAFE),
    "reward": _Column("<f8", "E", "decision.forecast.reward"),
    "flags": _Column("<i8", "E", "decision.forecast.flags", 0, 1 << 50),
    "admissible": _Column("|b1", "E", "decision.admissible", 0, 1),
    "env_reward": _Column("<f8", "", "env_reward", -_SUMMED, _SUMMED),
    "domain_reward": _Column("<f8", "", "domain_reward", -_SUMMED, _SUMMED),
    "unsafe": _Column("|b1", "", "unsafe_observed", 0, 1),
    "terminated": _Column("|b1", "", "terminated", 0, 1),
    "truncated": _Column("|b1", "", "truncated", 0, 1),
    "next_state": _Column("<f8", "F", "next_state"),
}
_ENTERED: Final = [name for name, column in _COLUMNS.items() if column.of]
_entries: Final = attrgetter(*(_COLUMNS[name].of for name in _ENTERED))  # in one call, so fast
_LISTED: Final = {"actors": ACTORS, "reasons": REASONS, "bounds": tuple(Bound)}
_POSITIONS: Final = [
    {value: k for k, value in enumerate(_LISTED.get(str(_COLUMNS[name].high), ()))}
    for name in _ENTERED
]
"""Of each column that is entered: value → position in the list of the layout; empty if plain."""
COLUMNS: Final = tuple(_COLUMNS)


class Layout(BaseModel):
    """What a recording is of, the content of its header.

    Names of the F fluents, the E actions of the environment and the ground actions; of an
    evaluation what acted, and the seed from which those of its episodes follow; what the numbers
    of `executed_by`, `proposed_by`, `reason` and `bound` mean.
    """

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    format: Literal[2] = 2
    fluents: tuple[str, ...]
    actions: tuple[str, ...]
    ground_actions: tuple[str, ...]
    control_period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Seconds between two decisions."""
    policy: str | None = None
    seed: Annotated[int, Field(ge=0)] | None = None
    actors: tuple[str, ...] = tuple(map(str, ACTORS))
    reasons: tuple[str, ...] = tuple(map(str, REASONS))
    bounds: tuple[str, ...] = tuple(bound.name.lower() for bound in Bound)

    @classmethod
    def of(cls, model: TransitionModel, actions: ActionMap, **evaluation: Any) -> Layout:
        """Return the layout for the steps of a task; policy and seed are those of an evaluation."""
        return cls(
            fluents=tuple(fluent.name for fluent in model.fluents),
            actions=tuple(actions.name(k) for k in range(actions.size)),
            ground_actions=tuple(action.name for action in model.actions),
            control_period=model.dt,
            **evaluation,
        )

    @classmethod
    def read(cls, folder: Path) -> Layout:
        """Read the header of a recording; a RunError if it is missing, damaged, or too old."""
        file = folder / HEADER
        try:
            found = cls.model_validate_json(json.dumps(read_json(file, _AGAIN)))
            for name in ("actors", "reasons", "bounds"):
                if getattr(found, name) != cls.model_fields[name].default:
                    raise ValueError(f"it has other {name}")
        except ValueError as error:
            raise RunError(
                f"{file} was written by another version of serp, or is damaged: "
                f"{first_of(error)}. {_AGAIN}"
            ) from None
        return found

    @property
    def block(self) -> int:
        """Number of steps of a block, which takes about 1 MiB; the last may have fewer."""
        size = sum(column.nbytes for column in self.empty(1).values())
        return min(_BLOCK_STEPS, max(16, (1 << 20) // size))

    def shape(self, name: str, steps: int) -> tuple[int, ...]:
        """Return the shape of a column of so many steps."""
        per = _COLUMNS[name].per
        return (steps,) if not per else (steps, len(self.fluents if per == "F" else self.actions))

    def empty(self, steps: int) -> Columns:
        """Return columns of zeros."""
        return {name: np.zeros(self.shape(name, steps), c.kind) for name, c in _COLUMNS.items()}


def block_path(folder: Path, number: int) -> Path:
    """Return the file of a block, from 0."""
    return folder / f"block-{number:06}.npz"


def blocks_in(folder: Path) -> dict[int, Path]:
    """Return the blocks of a recording by their number, in order."""
    found = {int(m[1]): file for file in folder.iterdir() if (m := _NAME.fullmatch(file.name))}
    return dict(sorted(found.items()))


def encode(columns: Columns) -> bytes:
    """Return the content of a block."""
    file = io.BytesIO()
    # A fluent's values one after another are compressed better than a state's.
    arrays: dict[str, Any] = {name: np.asfortranarray(v) for name, v in columns.items()}
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def decode(file: Path, layout: Layout, names: Iterable[str] = COLUMNS) -> Columns:
    """Read columns of a block; a RunError unless they are what `encode` wrote for this layout."""
    found: Columns = {}
    try:
        data = io.BytesIO(read_regular(file, 1 << 28, _AGAIN))
        with zipfile.ZipFile(data) as archive:
            for name in dict.fromkeys(("number", *names)):
                steps = len(found["number"]) if found else layout.block
                shape, dtype = layout.shape(name, steps), np.dtype(_COLUMNS[name].kind)
                info = archive.getinfo(f"{name}.npy")
                if info.file_size > np.prod(shape) * dtype.itemsize + 256:  # 128 are a header's
                    raise ValueError(f"{name} is too large")
                with archive.open(info) as member:
                    values = npy.read_array(member, allow_pickle=False)
                fits = values.shape == shape or (not found and 0 < values.size == len(values))
                if not fits or values.dtype != dtype:
                    raise ValueError(f"{name} has shape {values.shape} and type {values.dtype}")
                if (wrong := _out_of_range(name, values, layout)) is not None:
                    raise ValueError(f"{name} holds {wrong}")
                found[name] = values
    except RunError:
        raise
    except Exception as error:  # of a dozen kinds: those of archives, compression and arrays
        raise RunError(f"{file} is damaged: {error}. {_AGAIN}") from error
    return {name: found[name] for name in names}


def _out_of_range(name: str, values: NDArray[Any], layout: Layout) -> str | None:
    """Return a value that a column cannot hold, or None."""
    column = _COLUMNS[name]
    high = column.high
    if isinstance(high, str):
        high = len(getattr(layout, high)) - 1
    if values.dtype.kind == "b":  # its bytes may be other than 0 and 1
        values = values.view(np.uint8)
    outside = ~((values >= column.low) & (values <= high))
    if column.nothing:
        outside &= values == values
    return str(values[outside].flat[0]) if outside.any() else None


@dataclass(frozen=True)
class StoredStep:
    """One recorded step.

    Attributes:
        step: Its position in the recording, from 0: the `step` of `decisions.csv`.
        episode: Number of its episode, from 1, in the order in which they begin.
        number: Its number in the episode, from 1.
        state: State `[F]` before it.
        next_state: State `[F]` after it.
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
    next_state: Vector
    decision: Decision
    env_reward: float
    domain_reward: float
    unsafe: bool
    terminated: bool
    truncated: bool


class Recording:
    """The steps that a run, or an evaluation of it, recorded.

    Blocks are read when they are needed. A recording that is being written can be read, up to its
    last complete block or flush. Its folder has `recording.json`, whose content is the `layout`.

    Raises:
        RunError: There is no recording there, or it is damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.layout = Layout.read(folder)
        blocks = blocks_in(folder)
        self._files = list(blocks.values())
        for number in range(len(blocks)):
            if number not in blocks:
                raise RunError(f"{folder} has no block {number}. Restore it from a copy.")
        last = len(self._read_block(len(blocks) - 1, ("number",))["number"]) if blocks else 0
        self._steps = max(0, len(blocks) - 1) * self.layout.block + last
        self._block = functools.lru_cache(8)(self._read_block)

    def __len__(self) -> int:
        """Return the number of steps."""
        return self._steps

    def _read_block(self, number: int, names: tuple[str, ...] = COLUMNS) -> Columns:
        found = decode(self._files[number], self.layout, dict.fromkeys(("number", *names)))
        if number < len(self._files) - 1 and len(found["number"]) != self.layout.block:
            raise RunError(f"{self._files[number]} has too few steps. Restore it from a copy.")
        return found

    def columns(self, *names: str, newest: int | None = None) -> Columns:
        """Return columns (docs/reference/run-folder.md) of all or the newest steps, `[N, ...]`."""
        first = 0 if newest is None else max(0, len(self) - newest)
        begin = first // self.layout.block
        parts = [self._read_block(number, names) for number in range(begin, len(self._files))]
        parts.insert(0, self.layout.empty(0))
        rest = first - begin * self.layout.block
        return {name: np.concatenate([part[name] for part in parts])[rest:] for name in names}

    @functools.cached_property
    def episodes(self) -> dict[int, NDArray[np.int64]]:
        """Number of an episode → its steps, in order. Episodes that run together interleave."""
        numbers = self.columns("episode")["episode"]
        order = np.argsort(numbers, kind="stable")
        names, starts = np.unique(numbers[order], return_index=True)
        return dict(zip(names.tolist(), np.split(order, starts)[1:], strict=True))

    @functools.cached_property
    def ranges(self) -> tuple[Vector, Vector]:
        """The smallest and the largest value `[F]` of every fluent, before all steps."""
        states = self.columns("state")["state"]
        return states.min(axis=0, initial=np.inf), states.max(axis=0, initial=-np.inf)

    @functools.cached_property
    def whole(self) -> list[int]:
        """Positions of the fluents that have whole numbers in all states."""
        states = self.columns("state")["state"]
        return np.flatnonzero((states == np.rint(states)).all(axis=0)).tolist()

    @functools.cached_property
    def usual_change(self) -> Vector:
        """The root mean square `[F]` of what a fluent changes by before the end of an episode."""
        steps = self.columns("state", "next_state", "terminated", "truncated")
        goes_on = ~(steps["terminated"] | steps["truncated"])
        squares = np.square(steps["next_state"] - steps["state"])[goes_on]
        change: Vector = np.sqrt(squares.sum(axis=0) / max(1, len(squares)))
        return change

    def step(self, step: int) -> StoredStep:
        """Return a step by its position, or raise a RunError."""
        if not 0 <= step < len(self):
            there = f"steps 0 to {len(self) - 1:,}" if len(self) else "no steps yet"
            raise RunError(f"there is no step {step:,}: {self.folder} holds {there}.")
        block, row = divmod(step, self.layout.block)
        columns = self._block(block)

        def at(name: str) -> Any:
            value, known = columns[name][row], _LISTED.get(str(_COLUMNS[name].high))
            if known is not None:
                return known[value]
            if isinstance(value, np.ndarray):  # a copy
                return value.astype(np.int64 if value.dtype.kind == "i" else value.dtype)
            return value.item()

        forecast = ActionForecast(**{name: at(name) for name in ActionForecast._fields})
        of_decision = [name for name in Decision._fields if name != "forecast"]
        decision = Decision(forecast=forecast, **{name: at(name) for name in of_decision})
        own = [each.name for each in fields(StoredStep) if each.name in _COLUMNS]
        return StoredStep(step=step, decision=decision, **{name: at(name) for name in own})

    def find(self, episode: int, number: int) -> int:
        """Return the position of step `number`, from 0, of an episode, from 1; or a RunError."""
        steps = self.episodes.get(episode)
        if steps is None:
            last = max(self.episodes, default=0)
            there = f"episodes 1 to {last:,}" if last else "no episode yet"
            raise RunError(f"there is no episode {episode:,}: {self.folder} holds {there}.")
        if not 0 <= number < len(steps):
            raise RunError(
                f"episode {episode:,} has no step {number:,}: it has "
                f"{plural(len(steps), 'step')}, counted from 0."
            )
        return int(steps[number])


def vetoed(columns: Columns) -> NDArray[np.bool_]:
    """Return `[n]` whether a proposal was refused in each step, by the `VETO_COLUMNS`."""
    by_planner = columns["proposed_by"] == ACTORS.index(Actor.PLANNER)
    accepted = columns["reason"] == REASONS.index(Reason.ACCEPTED)
    return np.asarray(~(by_planner | accepted))


def open_recording(run: Path, evaluation: str | None = None) -> Recording:
    """Open the recording in the folder of a run, or of an evaluation such as `serp-seed0`."""
    if evaluation is not None:
        found = evaluations_of(run)
        if evaluation not in found:
            there = f"there are {listed(found)}" if found else "`serp evaluate` makes one"
            raise RunError(f"{run} has no evaluation `{evaluation}`; {there}.")
        return Recording(existing_inside(run, EVALUATIONS, evaluation))
    if not (run / RECORDING / HEADER).is_file():
        there = "".join(f"\n  serp why {run} --evaluation {name}" for name in evaluations_of(run))
        raise RunError(
            f"{run} has no recording of its steps; `serp evaluate` records episodes of the policy."
            + (f" There are evaluations:{there}" if there else "")
        )
    return Recording(existing_inside(run, RECORDING))


def evaluations_of(run: Path) -> list[str]:
    """Return the names of the recorded evaluations of a run."""
    folder = run / EVALUATIONS
    if not folder.is_dir():
        return []
    return sorted(each.name for each in folder.iterdir() if (each / HEADER).is_file())


class Recorder(Closing):
    """Writes the steps of a recording, one after another. A context manager.

    Steps are written where a block is full, at `flush` and at `close`. Only the last block is ever
    written again. Of what has been recorded in the folder, so many `steps` are kept.

    Raises:
        RunError: There are fewer steps, they are of another layout, or the disk fails.
    """

    def __init__(self, folder: Path, layout: Layout, steps: int = 0) -> None:
        make_inside(folder.parent, folder.name)
        self._folder, self._layout = folder, layout
        self._block = layout.block
        self._number, self._rows = divmod(steps, self._block)
        self._columns = layout.empty(self._block)
        self._written = True
        if steps:
            self._keep(steps)
        for number, file in blocks_in(folder).items():
            if number >= self._number + (self._rows > 0):
                file.unlink()
        write_durably(folder / HEADER, json_text(layout.model_dump(exclude_none=True)))

    def _keep(self, steps: int) -> None:
        """Take over the steps that are there."""
        if Layout.read(self._folder) != self._layout:
            raise RunError(
                f"{self._folder / HEADER} does not belong to this run: names or sizes differ. "
                "Restore it from a copy, or begin a new run with another --out."
            )
        recorded = Recording(self._folder)
        if len(recorded) < steps:
            raise RunError(
                f"{self._folder} does not hold the {steps:,} steps that the run has made: blocks "
                "are missing. Restore them from a copy, or begin a new run with another --out."
            )
        if self._rows:
            last = decode(block_path(self._folder, self._number), self._layout)
            for name, values in last.items():
                self._columns[name][: self._rows] = values[: self._rows]

    def append(self, episode: int, step: StepRecord) -> None:
        """Add a step of an episode, from 1; nothing of it is kept that may change afterwards."""
        columns, row = self._columns, self._rows
        columns["episode"][row] = episode
        for name, positions, value in zip(_ENTERED, _POSITIONS, _entries(step), strict=True):
            columns[name][row] = positions[value] if positions else value
        self._rows += 1
        self._written = False
        if self._rows == self._block:
            self.flush()
            self._number, self._rows = self._number + 1, 0

    def flush(self) -> None:
        """Write the steps of the last block."""
        if not self._written:
            rows = {name: values[: self._rows] for name, values in self._columns.items()}
            write_durably(block_path(self._folder, self._number), encode(rows))
            self._written = True

    def close(self) -> None:
        """Write what is left; a second call does nothing."""
        self.flush()
