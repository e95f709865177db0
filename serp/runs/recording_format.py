"""The format of recorded steps: a header, and blocks of columns.

``recording.json``     names and sizes, see `Layout`
``block-000000.npz``   the columns of the first `Layout.block` steps, and so on

A block is an ordinary compressed `.npz` file (``numpy.load(file, allow_pickle=False)``), a column
an array of it. The bits of a block depend on its content alone. What is read is checked: names,
types, shapes, and the range of every number that something is looked up by.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple, Self

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from serp._util.files import json_text, read_json, read_regular
from serp.agent.decision import Actor, Reason
from serp.agent.step_record import StepRecord
from serp.errors import RunError
from serp.model.transition_model import TransitionModel
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE
from serp.tasks.action_map import ActionMap

RECORDING: Final = "recording"
EVALUATIONS: Final = "evaluations"
"""Folders in that of a run: its recording, and those of evaluations by their name."""
HEADER: Final = "recording.json"
ACTORS: Final = tuple(Actor)
REASONS: Final = tuple(Reason)
Columns = dict[str, NDArray[Any]]
"""Name of a column → values `[n]`, `[n, F]` or `[n, E]` of n steps; `final_state` has a row for
each step that ended an episode."""

_BLOCK_BYTES: Final = 1 << 20
_LARGEST_BLOCK: Final = 1 << 28
_NAME: Final = re.compile(r"block-(\d{6,9})\.npz")
_AGAIN: Final = "Restore it from a copy; metrics.csv and decisions.csv can still be read."

_HUGE: Final = float(np.finfo(np.float64).max)
_SUMMED: Final = 1e280
"""Most of what is summed over a recording: the sum is finite, too."""


class _Column(NamedTuple):
    """A column of a block.

    Attributes:
        kind: Its type.
        per: What a step has an entry for: `F` fluents, `E` actions of the environment, or neither.
        of: Attribute of a `StepRecord` that is entered; empty if no attribute is.
        low: The least that it holds.
        high: The most, or the list of the layout in which it holds positions.
        nothing: Whether it may hold NaN, for none.
    """

    kind: str
    per: str
    of: str
    low: float = -_HUGE
    high: float | str = _HUGE
    nothing: bool = False


_FINAL: Final = "final_state"
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
    "flags": _Column("<i8", "E", "decision.forecast.flags", 0, 1 << 40),
    "admissible": _Column("|b1", "E", "decision.admissible", 0, 1),
    "env_reward": _Column("<f8", "", "env_reward", -_SUMMED, _SUMMED),
    "domain_reward": _Column("<f8", "", "domain_reward", -_SUMMED, _SUMMED),
    "unsafe": _Column("|b1", "", "unsafe_observed", 0, 1),
    "terminated": _Column("|b1", "", "terminated", 0, 1),
    "truncated": _Column("|b1", "", "truncated", 0, 1),
    _FINAL: _Column("<f8", "F", ""),
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
    """What a recording is of, the content of its header."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")

    format: Literal[1] = 1
    fluents: tuple[str, ...]
    """Names of the fluents, F."""
    actions: tuple[str, ...]
    """Names of the environment's actions, E."""
    ground_actions: tuple[str, ...]
    """Names of the ground actions."""
    control_period: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """Seconds between two decisions."""
    block: Annotated[int, Field(ge=1)]
    """Steps of a block; the last one may have fewer."""
    policy: str | None = None
    """What acted, of an evaluation."""
    seed: Annotated[int, Field(ge=0)] | None = None
    """Seed of an evaluation, from which those of its episodes follow."""
    actors: tuple[str, ...] = tuple(map(str, ACTORS))
    """What the numbers of `executed_by` and `proposed_by` mean."""
    reasons: tuple[str, ...] = tuple(map(str, REASONS))
    """What the numbers of `reason` mean."""
    bounds: tuple[str, ...] = tuple(bound.name.lower() for bound in Bound)
    """What the numbers of `bound` mean."""

    @model_validator(mode="after")
    def _require_small_blocks(self) -> Self:
        if self.block > (most := _steps_of_block(self.fluents, self.actions)):
            raise ValueError(f"block must be at most {most}")
        return self

    @classmethod
    def of(
        cls,
        model: TransitionModel,
        actions: ActionMap,
        *,
        policy: str | None = None,
        seed: int | None = None,
    ) -> Layout:
        """Return the layout for the steps of a task; policy and seed are those of an evaluation."""
        names = tuple(actions.name(k) for k in range(actions.size))
        fluents = tuple(fluent.name for fluent in model.fluents)
        return cls(
            fluents=fluents,
            actions=names,
            ground_actions=tuple(action.name for action in model.actions),
            control_period=model.dt,
            block=_steps_of_block(fluents, names),
            policy=policy,
            seed=seed,
        )

    @classmethod
    def read(cls, folder: Path) -> Layout:
        """Read the header of a recording.

        Raises:
            RunError: It is missing, damaged, or that of another version.
        """
        file = folder / HEADER
        content = read_json(file, _AGAIN)
        try:
            found = cls.model_validate_json(json.dumps(content))
        except ValidationError as error:
            wrong = error.errors(include_url=False)[0]
            what = ": ".join([*map(str, wrong["loc"]), wrong["msg"]])
            raise RunError(
                f"{file} was written by another version of serp, or is damaged: {what}. {_AGAIN}"
            ) from None
        tables: dict[str, tuple[str, ...]] = {}
        for name in ("actors", "reasons", "bounds"):
            tables[name] = cls.model_fields[name].default
            known: tuple[str, ...] = getattr(found, name)
            if tables[name][: len(known)] != known:  # more of them may have been appended since
                raise RunError(
                    f"{file} was written by another version of serp: it has other {name}. {_AGAIN}"
                )
        return found.model_copy(update=tables)

    def text(self) -> str:
        """Return the content of the header."""
        return json_text(self.model_dump(exclude_none=True))

    def shape(self, name: str, steps: int) -> tuple[int, ...]:
        """Return the shape of a column of so many steps."""
        per = _COLUMNS[name].per
        return (steps,) if not per else (steps, len(self.fluents if per == "F" else self.actions))

    def empty(self, steps: int) -> Columns:
        """Return columns of zeros."""
        return {name: np.zeros(self.shape(name, steps), dtype_of(name)) for name in COLUMNS}


def _steps_of_block(fluents: Sequence[str], actions: Sequence[str]) -> int:
    """Return of how many steps a block is, so that its columns take about `_BLOCK_BYTES`."""
    width = {"F": len(fluents), "E": len(actions), "": 1}
    size = sum(np.dtype(each.kind).itemsize * width[each.per] for each in _COLUMNS.values())
    return min(1024, max(16, _BLOCK_BYTES // size))


def dtype_of(name: str) -> np.dtype[Any]:
    """Return the type of a column."""
    return np.dtype(_COLUMNS[name].kind)


def enter(columns: Columns, row: int, episode: int, step: StepRecord) -> None:
    """Enter a step of an episode into a row of columns, all but the state after it."""
    columns["episode"][row] = episode
    for name, positions, value in zip(_ENTERED, _POSITIONS, _entries(step), strict=True):
        columns[name][row] = positions[value] if positions else value


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
    # Level 1 takes a third of the time of the default, for 3 % more bytes.
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, values in columns.items():
            array = io.BytesIO()
            # A fluent's values one after another are compressed better than a state's.
            npy.write_array(array, np.asfortranarray(values), (1, 0), allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy")  # of the year 1980, as the bits depend on it
            info.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(info, array.getvalue())
    return file.getvalue()


def decode(file: Path, layout: Layout, names: Iterable[str] = COLUMNS) -> Columns:
    """Read columns of a block.

    Raises:
        RunError: The file is missing or not what `encode` wrote for this layout.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_regular(file, _LARGEST_BLOCK))) as archive:
            wanted = dict.fromkeys(("number", "terminated", "truncated", *names))
            steps = len(_column(archive, "number", layout, layout.block, exact=False))
            found = {
                name: _column(archive, name, layout, steps) for name in wanted if name != _FINAL
            }
            if _FINAL in wanted:
                ends = int((found["terminated"] | found["truncated"]).sum())
                found[_FINAL] = _column(archive, _FINAL, layout, ends)
    except OSError as error:
        raise RunError(f"cannot read {file}: {error.strerror or error}. {_AGAIN}") from error
    except (ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, RuntimeError) as error:
        raise RunError(f"{file} is damaged ({error}). {_AGAIN}") from error
    for name, values in found.items():
        if (wrong := _out_of_range(name, values, layout)) is not None:
            raise RunError(f"{file} is damaged: {name} holds {wrong}. {_AGAIN}")
    return {name: found[name] for name in names}


def _column(
    archive: zipfile.ZipFile, name: str, layout: Layout, steps: int, *, exact: bool = True
) -> NDArray[Any]:
    """Read a column of so many steps; not `exact`: of at most so many."""
    shape, dtype = layout.shape(name, steps), dtype_of(name)
    info = archive.getinfo(f"{name}.npy")
    most = int(np.prod(shape)) * dtype.itemsize + 256  # a header has 128 bytes
    if info.file_size > most:
        raise ValueError(f"{name} is too large")
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is compressed in another way")
    with archive.open(info) as member:
        data = io.BytesIO(member.read(most))
    if npy.read_magic(data) != (1, 0):
        raise ValueError(f"{name} is no array of format 1.0")
    try:
        found, fortran, kind = npy.read_array_header_1_0(data)
    except Exception as error:  # of half a dozen kinds: NumPy reads the header as Python
        raise ValueError(f"{name} has no header of an array") from error
    fits = found == shape if exact else len(found) == 1 and 0 < found[0] <= steps
    if not fits or kind != dtype:
        raise ValueError(f"{name} has shape {found} and type {kind}")
    values = np.frombuffer(data.getvalue()[data.tell() :], dtype)
    return values.reshape(found, order="F" if fortran else "C")


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
