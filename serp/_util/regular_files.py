"""Opens the files of a run: regular files only, and no links.

A run may come from somebody else. A link in it could let a file elsewhere be read or overwritten, a
named pipe would be waited for without end.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from serp.errors import RunError

_BINARY = getattr(os, "O_BINARY", 0)  # Windows would translate line ends without it
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0)
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)  # for the other end of a pipe


def open_regular(path: Path, flags: int) -> int:
    """Opens a regular file and returns its descriptor.

    A file opened for writing must have no other name: what is written in place would be written
    under that name, too.

    Args:
        path: the file.
        flags: those of `os.open`.

    Raises:
        RunError: it is something else.
        OSError: it cannot be opened.
    """
    if not _NO_LINKS and path.is_symlink():
        raise _irregular(path)
    try:
        file = os.open(path, flags | _NO_LINKS | _NO_WAITING | _BINARY, 0o666)
    except OSError as error:
        # A link; a pipe that nobody reads; a folder.
        if error.errno in (errno.ELOOP, errno.EMLINK, errno.ENXIO, errno.EISDIR):
            raise _irregular(path) from None
        raise
    found = os.fstat(file)
    if not stat.S_ISREG(found.st_mode):
        os.close(file)
        raise _irregular(path)
    if flags & (os.O_WRONLY | os.O_RDWR) and found.st_nlink > 1:
        os.close(file)
        raise RunError(
            f"{path} has another name elsewhere (a hard link), under which it would be changed, "
            "too. Copy it, remove it, and give the copy its name."
        )
    return file


def make_inside(folder: Path, *names: str) -> Path:
    """Makes folders in one another, none of them a link to elsewhere; returns the innermost.

    Args:
        folder: the outermost, which is there and may be a link itself.
        names: of the folders below it; those that are there are kept.

    Raises:
        RunError: one of them is a link.
        OSError: one of them is a file, or cannot be made.
    """
    for name in names:
        folder = folder / name
        folder.mkdir(exist_ok=True)
        if folder.is_symlink():
            raise RunError(f"{folder} is a link. Put a folder there, or remove it.")
    return folder


def read_regular(path: Path, most: int | None = None) -> bytes:
    """Reads all of a regular file.

    Args:
        path: the file.
        most: bytes that it may have; by default what fits into memory.

    Raises:
        RunError: it is something else, or too large.
        OSError: it cannot be read.
    """
    with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        try:
            if most is not None and size > most:
                raise MemoryError
            return file.read()
        except MemoryError:
            raise RunError(
                f"{path} is too large ({size:,} bytes): it is not what serp wrote there. Restore "
                "it from a copy."
            ) from None


def require_regular(path: Path) -> Path:
    """Returns the path, for others to open, if nothing but a regular file is there.

    Raises:
        RunError: it is something else. That nothing is there is for others to notice.
    """
    try:
        mode = os.lstat(path).st_mode
    except OSError:
        return path
    if not stat.S_ISREG(mode):
        raise _irregular(path)
    return path


def _irregular(path: Path) -> RunError:
    return RunError(
        f"{path} is a link, a folder, a pipe or a device. A run is made of regular files; put the "
        "file itself there."
    )
