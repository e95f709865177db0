"""The folder of a comparison while it is written: locked, and gone where nothing was begun."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

from serp.comparison.storage import PLAN
from serp.runs.durable import cannot_write
from serp.runs.lock import RunLock


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Make a folder and lock it; where no plan was written, what was made is removed again.

    Args:
        folder: It may exist.

    Raises:
        RunError: It cannot be made, or another process writes it.
    """
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    try:
        lock = RunLock(folder)
        try:
            yield
        finally:
            lock.release()
    finally:
        if folder in missing and not (folder / PLAN).exists():
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # somebody else has put something there
                for place in missing[1:]:
                    place.rmdir()
