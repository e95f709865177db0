"""Where a new run goes: a folder of its own, and nothing in it that was there before."""

from __future__ import annotations

import datetime
import os
import re
from collections.abc import Collection, Iterable
from pathlib import Path

from serp._util.files import cannot_write
from serp.errors import RunError
from serp.runs.config import CONFIG
from serp.runs.lock import LOCK


def default_path(domain_name: str, now: datetime.datetime | None = None) -> Path:
    """Return the folder of a run that was given none: ``runs/<domain>-<time>``, unused so far.

    Args:
        domain_name: Name of the domain; what a folder's name cannot hold becomes a hyphen.
        now: The time in it; the present local time by default.

    Returns:
        A path that does not exist; ``-2``, ``-3``, … is appended where the first one does.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", domain_name).strip("-.") or "run"
    stamp = (now or datetime.datetime.now()).strftime("%Y%m%d-%H%M%S")
    first = path = Path("runs") / f"{name}-{stamp}"
    number = 1
    while os.path.lexists(path):
        number += 1
        path = first.with_name(f"{first.name}-{number}")
    return path


def make_empty(path: Path, traces: Collection[str]) -> bool:
    """Make the folder of a new run; False where an empty one was there.

    Args:
        path: The folder.
        traces: What a run that was stopped before it began may have left there; it counts for
            nothing.

    Raises:
        RunError: It is a file, holds something, or cannot be made.
    """
    try:
        path.mkdir(parents=True)
        return True
    except FileExistsError:
        pass
    except OSError as error:
        raise cannot_write(path, error, "Nothing was made.") from error
    try:
        names = {entry.name for entry in path.iterdir()}
    except NotADirectoryError:
        raise RunError(f"{path} is a file. Give another folder with --out.") from None
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror or error}.") from error
    # The lock says that it was a run that left the rest, stopped before it began. In a folder
    # without one, a domain.pddl may be the user's own.
    if names and not (LOCK in names and names <= {LOCK, *traces}):
        raise occupied(path)
    return False


def occupied(path: Path) -> RunError:
    """Return the error for a folder that holds something."""
    if os.path.lexists(path / CONFIG):
        return RunError(
            f"{path} holds a run already. Continue it with --resume, or give another folder with "
            "--out. Nothing was changed."
        )
    return RunError(
        f"{path} is not empty. Give a new or empty folder with --out. Nothing was changed."
    )


def remove_traces(path: Path, traces: Iterable[str]) -> None:
    """Remove what a run that was stopped or failed before it began left in a folder.

    Raises:
        RunError: It cannot be removed.
    """
    if os.path.lexists(path / CONFIG):  # another process's run
        return
    for name in traces:
        try:
            (path / name).unlink(missing_ok=True)
        except OSError as error:
            raise cannot_write(path / name, error, "Nothing was changed.") from error
