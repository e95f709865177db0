"""Writes a file so that a crash, a full disk or a cut cable leaves the old one or the new one."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping
from pathlib import Path

from serp._util.regular_files import open_regular
from serp.errors import RunError

_ADVICE = {
    errno.ENOSPC: "Free some space on that disk",
    errno.EDQUOT: "Free some of your quota on that disk",
    errno.EFBIG: "Raise the limit on the size of files (ulimit -f)",
    errno.EACCES: "Make the folder writable",
    errno.EPERM: "Make the folder writable",
    errno.EROFS: "Use a disk that is not read-only",
    errno.ENOENT: "Make sure that the folder still exists",
}


def cannot_write(path: Path, error: OSError, kept: str) -> RunError:
    """The error for a write that failed.

    Args:
        path: the file that was to be written.
        error: what the operating system said.
        kept: a sentence saying what is left on the disk.
    """
    reason = error.strerror or str(error)
    advice = _ADVICE.get(error.errno or 0, "Mend that")
    return RunError(f"cannot write {path}: {reason}. {kept} {advice}, then try again.")


def write_all(file: int, content: bytes) -> None:
    """Writes every byte of `content` to the file descriptor, however the system cuts it up."""
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(file, rest) :]


def aside_of(path: Path) -> Path:
    """The place in the same folder where the next version of `path` is written.

    It has one fixed name, so that the next write clears away what a killed process left there.
    """
    return path.with_name(path.name + ".aside")


def write_aside(path: Path, content: bytes) -> Path:
    """Writes `content` beside `path`, flushed to the disk, and returns where.

    Raises:
        RunError: the write failed; the file aside is removed and `path` is as it was.
    """
    aside = aside_of(path)
    try:
        try:
            # What lies there may be a link to a file elsewhere.
            aside.unlink(missing_ok=True)
            file = open_regular(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            try:
                write_all(file, content)
                os.fsync(file)
            finally:
                os.close(file)
        except BaseException:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise cannot_write(path, error, what_is_kept(path)) from error
    return aside


def what_is_kept(path: Path) -> str:
    """The sentence that says what a failed write left of `path`."""
    if os.path.lexists(path):
        return f"The former {path.name} is kept whole."
    return f"No {path.name} was there before, and none was left half written."


def sync_folder(folder: Path) -> None:
    """Makes the renames in `folder` durable, where the operating system can do that.

    Raises:
        OSError: the disk failed.
    """
    if os.name == "nt":  # Windows opens no folders; its renames are journalled
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some network and user-space file systems know no fsync of folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def write_durably(path: Path, content: bytes | str) -> None:
    """Replaces `path` by `content` (text as UTF-8) in one step that survives a crash.

    Written aside in the same folder, flushed, renamed over `path`, and the folder flushed.

    Raises:
        RunError: the write failed; says why, and that the former file is whole.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    aside = write_aside(path, data)
    try:
        os.replace(aside, path)
        sync_folder(path.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)
        raise cannot_write(path, error, what_is_kept(path)) from error


def write_together(contents: Mapping[Path, str]) -> None:
    """Replaces several files, none of them before all are safely on the disk.

    Args:
        contents: file → its text, written as UTF-8.

    Raises:
        RunError: a write failed, or one of the files is a folder. All are as they were, unless it
            was the replacing itself that failed: then those before it are new.
    """
    for path in contents:
        if path.is_dir():
            raise RunError(f"cannot write {path}: it is a folder. Give the name of a file.")
    written: list[Path] = []
    try:
        for path, text in contents.items():
            written.append(write_aside(path, text.encode("utf-8", "backslashreplace")))
        for path, aside in zip(contents, written, strict=True):
            try:
                os.replace(aside, path)
                sync_folder(path.parent)
            except OSError as error:
                raise cannot_write(path, error, what_is_kept(path)) from error
    finally:
        for aside in written:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
