"""The lock of a run folder: one process at a time writes; reading needs no lock."""

from __future__ import annotations

import contextlib
import datetime
import os
import socket
from pathlib import Path
from typing import Final

from filelock import FileLock, Timeout

from serp._util.files import cannot_write, refuse_hard_link, require_regular
from serp.errors import RunError

LOCK: Final = ".lock"


class RunLock:
    """A lock on a run folder, held until `release` or the end of the process.

    The operating system releases it when the process dies, so that there are no stale locks. The
    file ``.lock`` in the run names the owner of the lock and its time. A lock that another process
    (or another lock of this one) holds, or that cannot be had, is a `RunError`.
    """

    def __init__(self, folder: Path) -> None:
        self._path = require_regular(folder / LOCK)
        # Any thread may release the lock. A soft lock, for file systems without locks, would
        # survive a crash.
        self._lock = FileLock(
            self._path,
            blocking=False,
            thread_local=False,
            fallback_to_soft=False,
            on_acquired=self._write_owner,
        )
        try:
            self._lock.acquire()
        except Timeout:
            raise RunError(
                f"the run {folder} is being written by {self._owner()}. Wait until that has ended, "
                "or begin a new run with another --out."
            ) from None
        except PermissionError as error:
            raise cannot_write(self._path, error, "The run is unchanged.") from error
        except OSError as error:
            raise RunError(
                f"the run {folder} cannot be locked: {error.strerror or error}. Give --out a "
                "folder on a local disk."
            ) from error

    def release(self) -> None:
        """Release the lock; a second call does nothing."""
        self._lock.release()

    def _write_owner(self, file: int) -> None:
        refuse_hard_link(self._path, file)
        now = datetime.datetime.now().astimezone().isoformat(" ", "seconds")
        text = f"process {os.getpid()} on {socket.gethostname()} since {now}\n"
        with contextlib.suppress(OSError):  # informative only; a full disk must not stop a resume
            os.ftruncate(file, 0)
            os.write(file, text.encode())

    def _owner(self) -> str:
        with contextlib.suppress(OSError), open(self._path, "rb") as file:
            return file.read(200).decode("utf-8", "replace").strip() or "another process"
        return "another process"
