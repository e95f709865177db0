"""One process at a time writes a run; reading is always allowed."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from pathlib import Path

from serp._util.durable_files import cannot_write
from serp._util.regular_files import open_regular
from serp.errors import RunError

LOCK = ".lock"

if sys.platform == "win32":
    import msvcrt

    def _take(file: int) -> None:
        # Far beyond the text: on Windows a locked byte cannot be read by others.
        os.lseek(file, 1 << 30, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)

else:
    import fcntl

    def _take(file: int) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


class RunLock:
    """An advisory lock on a folder, held until `release` or the end of the process.

    The operating system drops it when the process dies, however it dies, so that no stale lock
    ever has to be removed by hand.

    Args:
        folder: the run; the file ``.lock`` in it says who holds the lock.

    Raises:
        RunError: another process (or this one, elsewhere) holds it, or the folder cannot be
            locked.
    """

    def __init__(self, folder: Path) -> None:
        path = folder / LOCK
        try:
            self._file: int | None = open_regular(path, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise cannot_write(path, error, "The run is as it was.") from error
        try:
            _take(self._file)
        except (BlockingIOError, PermissionError) as error:
            owner = self._owner()
            self.release()
            raise RunError(
                f"the run {folder} is being written by {owner}. Wait until that has ended, or "
                "begin a run of your own with another --out."
            ) from error
        except OSError as error:
            self.release()
            raise RunError(
                f"the run {folder} cannot be locked: {error.strerror or error}. Give --out a "
                "folder on a local disk."
            ) from error
        with contextlib.suppress(OSError):  # a courtesy only; a full disk must not stop a resume
            os.ftruncate(self._file, 0)
            os.lseek(self._file, 0, os.SEEK_SET)
            os.write(self._file, f"process {os.getpid()} on {socket.gethostname()}\n".encode())

    def release(self) -> None:
        """Gives the lock back; a second call does nothing."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _owner(self) -> str:
        assert self._file is not None
        os.lseek(self._file, 0, os.SEEK_SET)
        text = os.read(self._file, 200).decode("utf-8", "replace").strip()
        return text or "another process"
