"""The folder of a run, which one process at a time writes and any process reads.

``config.json``             resolved configuration, seed, command, versions, machine
``domain.pddl``             copy of the domain (and ``problem.pddl``, if there is one)
``metrics.csv``             one row per episode
``decisions.csv``           one row per decision
``recording``               every step in numbers, see `serp.runs.recording`
``checkpoint.safetensors``  the newest training state
``summary.json``, ``learning-curve.png``, ``learning-curve.svg``  the results

What cannot be read or written is a `RunError`.
"""

from __future__ import annotations

import contextlib
import datetime
import itertools
import os
import re
import socket
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from serp._util.files import aside_of, cannot_write, refuse_hard_link, require_regular
from serp.errors import RunError
from serp.runs.run_config import CONFIG

LOCK: Final = ".lock"


def lock_folder(folder: Path) -> FileLock:
    """Return a lock on a folder, held until its `release` or the end of the process.

    The operating system releases it when the process dies, so that there are no stale locks. The
    file ``.lock`` in the folder names the owner of the lock and its time. A lock that another
    process (or another lock of this one) holds, or that cannot be had, is a `RunError`.
    """
    path = require_regular(folder / LOCK)

    def write_owner(file: int) -> None:
        refuse_hard_link(path, file)
        now = datetime.datetime.now().astimezone().isoformat(" ", "seconds")
        text = f"process {os.getpid()} on {socket.gethostname()} since {now}\n"
        with contextlib.suppress(OSError):  # informative only; a full disk must not stop a resume
            os.ftruncate(file, 0)
            os.write(file, text.encode())

    # Any thread may release the lock. A soft lock, for file systems without locks, would survive a
    # crash.
    lock = FileLock(
        path, blocking=False, thread_local=False, fallback_to_soft=False, on_acquired=write_owner
    )
    try:
        lock.acquire()
    except Timeout:
        owner = ""
        with contextlib.suppress(OSError), open(path, "rb") as file:
            owner = file.read(200).decode("utf-8", "replace").strip()
        raise RunError(
            f"the run {folder} is being written by {owner or 'another process'}. Wait until "
            "the run has ended, or begin a new run with another --out."
        ) from None
    except PermissionError as error:
        raise cannot_write(path, error, "The run is unchanged.") from error
    except OSError as error:
        raise RunError(
            f"the run {folder} cannot be locked: {error.strerror or error}. Give --out a folder on "
            "a local disk."
        ) from error
    return lock


def default_path(domain_name: str) -> Path:
    """Return the default folder of a run: ``runs/<domain>-<time>``, and ``-2``, … if it exists."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", domain_name).strip("-.") or "run"
    stamp = datetime.datetime.now().strftime("%Y%m%d-%H%M%S")
    endings = itertools.chain([""], (f"-{number}" for number in itertools.count(2)))
    paths = (Path("runs") / f"{name}-{stamp}{ending}" for ending in endings)
    return next(path for path in paths if not os.path.lexists(path))


def make_empty(path: Path) -> None:
    """Create the folder of a new run, unless it exists and is empty; see `refuse_occupied`."""
    refuse_occupied(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(path, error, "Nothing was made.") from error


def refuse_occupied(path: Path) -> None:
    """Raise a RunError if a new run cannot have a folder, because there is something in it.

    What a run left that was stopped before its beginning is ignored. Its lock file shows that the
    other files are its own: without it, a domain.pddl may be the user's.
    """
    if path.is_file():
        raise RunError(f"{path} is a file. Give another folder with --out.")
    try:
        names = set(os.listdir(path))
    except FileNotFoundError:
        return
    except OSError as error:
        raise cannot_write(path, error, "Nothing was made.") from error
    if CONFIG in names:
        raise RunError(
            f"{path} already holds a run. Continue it with --resume, or give another folder with "
            "--out. Nothing was changed."
        )
    if names and not (LOCK in names and names <= _LEFT):
        raise RunError(
            f"{path} is not empty. Give a new or empty folder with --out. Nothing was changed."
        )


METRICS: Final = "metrics.csv"
DECISIONS: Final = "decisions.csv"
SUMMARY: Final = "summary.json"
COPIES: Final = ("domain.pddl", "problem.pddl")
"""Names of the copies of the domain file and, if there is one, of its problem file."""
_LEFT: Final = {LOCK, *COPIES, *(aside_of(Path(name)).name for name in (*COPIES, CONFIG))}
"""What a run may leave that is stopped before its beginning: `CONFIG` is written last."""
