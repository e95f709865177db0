"""The files of complete trials.

    comparison/trials/ALGORITHM/VARIANT/seed-N/episodes.csv, evaluations.csv, trial.json

`trial.json` is written last: a trial without it was interrupted, and is run again.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np

from serp._util.files import cannot_write, finite, json_text, make_inside, read_json, write_durably
from serp.errors import RunError
from serp.runs.comparison.plan import (
    ADDED,
    EPISODE_COLUMNS,
    EVALUATION_COLUMNS,
    Columns,
    EpisodeRow,
    EvaluationRow,
    Record,
    Trial,
)
from serp.runs.comparison.trial import Measured
from serp.runs.tables import Table, read_rows

_DONE: Final = "trial.json"
_EPISODES: Final = "episodes.csv"
_EVALUATIONS: Final = "evaluations.csv"
_LONGEST: Final = 100
_ADVICE: Final = "Remove the folder of this trial to run it again."


def trial_folder(folder: Path, trial: Trial) -> Path:
    """Return the folder of a trial."""
    names = (file_name(trial.algorithm), file_name(trial.variant), f"seed-{trial.seed}")
    return folder.joinpath("trials", *names)


def file_name(name: str) -> str:
    """Return a unique file name for a name, valid on every file system."""
    plain = re.sub(r"[^A-Za-z0-9_.=-]", "_", name)
    if plain == name and len(name) <= _LONGEST and not plain.startswith("."):
        return plain
    return f"{plain[:_LONGEST]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}"


def digest(made_of: Mapping[str, Any]) -> str:
    """Return a digest of JSON values."""
    return hashlib.sha256(json.dumps(finite(made_of), sort_keys=True).encode()).hexdigest()


def write_trial(
    folder: Path, trial: Trial, measured: Measured, metadata: Mapping[str, Any]
) -> None:
    """Write a complete trial, replacing files of an interrupted one."""
    place = _emptied(folder, trial)
    counters = measured.log.counters
    with Table(place / _EPISODES, [*EPISODE_COLUMNS, *_named(counters)]) as table:
        for row, counts in measured.log.rows:
            table.append((*row, *counts))
    with Table(place / _EVALUATIONS, EVALUATION_COLUMNS) as table:
        for evaluation in measured.evaluations:
            table.append(evaluation)
    content = {
        **trial._asdict(),
        **metadata,
        "characteristics": measured.characteristics,
        "seconds": measured.seconds,
        "versions": measured.versions,
        "lead": measured.lead,
        "counters": counters,
    }
    write_durably(place / _DONE, json_text(finite(content)))


def copy_trial(source: Path, folder: Path, trial: Trial) -> None:
    """Copy a complete trial of another comparison, replacing an interrupted one."""
    place = _emptied(folder, trial)
    for name in (_EPISODES, _EVALUATIONS, _DONE):
        write_durably(place / name, (trial_folder(source, trial) / name).read_bytes())


def _emptied(folder: Path, trial: Trial) -> Path:
    """Return the folder of a trial, made anew."""
    place = trial_folder(folder, trial)
    try:
        make_inside(folder, *place.parent.relative_to(folder).parts)
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
    except OSError as error:
        raise cannot_write(place, error, "The trial is lost.") from error
    return place


def is_complete(folder: Path, trial: Trial) -> bool:
    """Return whether a trial is complete."""
    return (trial_folder(folder, trial) / _DONE).is_file()


def read_metadata(folder: Path, trial: Trial) -> dict[str, Any]:
    """Return the content of the `trial.json` of a complete trial."""
    return read_json(trial_folder(folder, trial) / _DONE, _ADVICE)


def read_trial(folder: Path, trial: Trial) -> Record:
    """Return a complete trial."""
    place = trial_folder(folder, trial)
    metadata = read_metadata(folder, trial)
    counters = metadata.get("counters")
    if not isinstance(counters, list):
        raise RunError(f"{place / _DONE} is damaged: counters is not a list. {_ADVICE}")
    columns = [*EPISODE_COLUMNS, *_named(counters)]
    episodes = _read(place / _EPISODES, columns, EpisodeRow)
    evaluations = _read(place / _EVALUATIONS, EVALUATION_COLUMNS, EvaluationRow)
    return Record(trial, episodes, evaluations, metadata)


def _named(counters: Sequence[str]) -> list[str]:
    return [f"info.{name}" for name in counters]


def _read(path: Path, columns: Sequence[str], row: Any) -> Columns:
    hints = {name.removesuffix("_"): kind for name, kind in get_type_hints(row).items()}
    hints |= {name: _or_nothing for name in ADDED}
    kinds = {name: hints.get(name, float) for name in columns}
    cells: dict[str, list[Any]] = {name: [] for name in columns}
    for number, values in read_rows(path, columns, ADDED):
        for (name, kind), text in zip(kinds.items(), values, strict=True):
            try:
                cells[name].append(bool(int(text)) if kind is bool else kind(text))
            except ValueError:
                raise RunError(f"{path}:{number}: {name} is {text!r}. {_ADVICE}") from None
    return {
        name: np.array(values, dtype=float if kinds[name] is _or_nothing else kinds[name])
        for name, values in cells.items()
    }


def _or_nothing(text: str) -> float:
    """Return a number, NaN for an empty cell."""
    return float(text or "nan")
