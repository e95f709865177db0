"""The folder of a new run: its default name, and checks that it is empty."""

from __future__ import annotations

import datetime
import os
import re
from collections.abc import Callable
from pathlib import Path

from serp._util.files import cannot_write
from serp.errors import RunError
from serp.runs.config import CONFIG
from serp.runs.lock import LOCK


def default_path(domain_name: str, now: datetime.datetime | None = None) -> Path:
    """Return the default folder of a run: ``runs/<domain>-<time>``, and ``-2``, … if it exists."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", domain_name).strip("-.") or "run"
    stamp = (now or datetime.datetime.now()).strftime("%Y%m%d-%H%M%S")
    first = path = Path("runs") / f"{name}-{stamp}"
    number = 1
    while os.path.lexists(path):
        number += 1
        path = first.with_name(f"{first.name}-{number}")
    return path


def make_empty(path: Path, is_trace: Callable[[str], bool]) -> None:
    """Create the folder of a new run, unless it exists and is empty; see `refuse_occupied`."""
    refuse_occupied(path, is_trace)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error, "Nothing was made.") from error


def refuse_occupied(path: Path, is_trace: Callable[[str], bool]) -> None:
    """Raise a RunError if a new run cannot have a folder, because there is something in it.

    The files that a run stopped before its beginning may have left (`is_trace`) are ignored.
    """
    if path.is_file():
        raise RunError(f"{path} is a file. Give another folder with --out.")
    try:
        names = set(os.listdir(path))
    except FileNotFoundError:
        return
    except OSError as error:
        raise cannot_write(path, error, "Nothing was made.") from error
    # The lock file shows that a run left the other files. Without it, a domain.pddl may be the
    # user's own.
    if names and not (LOCK in names and all(map(is_trace, names - {LOCK}))):
        raise occupied(path)


def occupied(path: Path) -> RunError:
    """Return the error for a folder that is not empty."""
    if os.path.lexists(path / CONFIG):
        return RunError(
            f"{path} already holds a run. Continue it with --resume, or give another folder with "
            "--out. Nothing was changed."
        )
    return RunError(
        f"{path} is not empty. Give a new or empty folder with --out. Nothing was changed."
    )
