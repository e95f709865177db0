"""The folder of a comparison while it is written: locked, and gone where nothing was begun."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

from serp._util.files import cannot_write
from serp.compare.storage import DOMAINS, PLAN
from serp.errors import RunError
from serp.runs.config import CONFIG
from serp.runs.lock import LOCK, RunLock


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Make a folder and lock it; where no plan was written, what was made is removed again.

    Args:
        folder: It may exist.

    Raises:
        RunError: It cannot be made, holds something else, or another process writes it.
    """
    _refuse_foreign(folder)
    missing = [place for place in (folder, *folder.parents) if not place.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error, "Nothing was made.") from error
    lock = RunLock(folder)
    try:
        yield
    finally:
        begun = (folder / PLAN).exists()
        if not begun:  # what is there was made here: the folder was empty before
            shutil.rmtree(folder / DOMAINS, ignore_errors=True)
        lock.release()
        if folder in missing and not begun:
            shutil.rmtree(folder, ignore_errors=True)
            with contextlib.suppress(OSError):  # somebody else has put something there
                for place in missing[1:]:
                    place.rmdir()


def _refuse_foreign(folder: Path) -> None:
    """Refuse a folder that holds something, and no comparison.

    Raises:
        RunError: It does.
    """
    if not folder.is_dir() or (folder / PLAN).exists():
        return
    if any(entry.name != LOCK for entry in folder.iterdir()):
        what = "a run" if (folder / CONFIG).exists() else "other files"
        raise RunError(
            f"{folder} holds {what}, no comparison. Give a new or empty folder with --out. Nothing "
            "was changed."
        )
