"""Reads and writes the files of a run: regular files only, replaced atomically.

A run may come from an untrusted source: a link in it could cause a file elsewhere to be read or
overwritten, and a named pipe would block forever. A crash, a full disk or a lost network drive
leaves either the previous file or the new one. What is refused or fails is a `RunError`.
"""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import stat
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, Self

import numpy as np

from serp.errors import RunError, SerpError


class Closing:
    """A context manager that calls `close` on exit, whose error never hides one of the body."""

    def close(self) -> None:
        """Release what is held; a second call does nothing."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        hidden = (SerpError, OSError) if kind is not None else ()
        with contextlib.suppress(*hidden):
            self.close()


_BINARY = getattr(os, "O_BINARY", 0)  # Windows would translate line ends without it
_NO_LINKS = getattr(os, "O_NOFOLLOW", 0)
_NO_WAITING = getattr(os, "O_NONBLOCK", 0)  # for the other end of a pipe

_ADVICE = {
    errno.ENOSPC: "Free some space on that disk",
    errno.EDQUOT: "Free some of your quota on that disk",
    errno.EFBIG: "Raise the limit on file sizes (ulimit -f)",
    errno.EACCES: "Make the folder writable",
    errno.EPERM: "Make the folder writable",
    errno.EROFS: "Use a disk that is not read-only",
    errno.ENOENT: "Make sure that the folder still exists",
}


def open_regular(path: Path, flags: int) -> int:
    """Open a regular file and return its descriptor.

    A file opened for writing must have no second hard link, because it would be changed under that
    name, too.
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
    try:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            raise _irregular(path)
        if flags & (os.O_WRONLY | os.O_RDWR):
            refuse_hard_link(path, file)
    except RunError:
        os.close(file)
        raise
    return file


def refuse_hard_link(path: Path, file: int) -> None:
    """Raise a `RunError` if an open file has a name besides `path`."""
    if os.fstat(file).st_nlink > 1:
        raise RunError(
            f"{path} is a hard link: writing to it would also change another file. Copy the file, "
            f"remove the link, and rename the copy to {path.name}."
        )


def read_regular(
    path: Path, most: int | None = None, advice: str = "Restore it from a copy."
) -> bytes:
    """Read all of a regular file of at most `most` bytes, by default what fits into memory.

    `advice` ends the message of the `RunError` if it cannot be read.
    """
    try:
        with os.fdopen(open_regular(path, os.O_RDONLY), "rb") as file:
            size = os.fstat(file.fileno()).st_size
            try:
                if most is not None and size > most:
                    raise MemoryError
                return file.read()
            except MemoryError:
                raise RunError(
                    f"{path} is too large ({size:,} bytes) to be a file that serp wrote. {advice}"
                ) from None
    except OSError as error:
        raise RunError(f"cannot read {path}: {error.strerror or error}. {advice}") from error


def require_regular(path: Path) -> Path:
    """Return the path if it is a regular file or does not exist."""
    try:
        mode = os.lstat(path).st_mode
    except OSError:
        return path
    if not stat.S_ISREG(mode):
        raise _irregular(path)
    return path


def _irregular(path: Path) -> RunError:
    return RunError(
        f"{path} is a link, a folder, a pipe or a device. A run consists of regular files; put "
        "one at this path."
    )


def write_durably(path: Path, content: bytes | str) -> None:
    """Replace `path` by `content` (text as UTF-8) atomically and durably."""
    write_together({path: content})


def write_together(contents: Mapping[Path, bytes | str]) -> None:
    """Replace several files (text as UTF-8), none before all new ones are flushed to the disk."""
    for path in contents:
        if path.is_dir():
            raise RunError(f"cannot write {path}: it is a folder. Give a file name.")
    with contextlib.ExitStack() as stack:
        for path, content in contents.items():
            aside = stack.enter_context(replaced_durably(path))
            if isinstance(content, str):
                content = content.encode("utf-8", "backslashreplace")
            with open(aside, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())


@contextlib.contextmanager
def replaced_durably(path: Path) -> Iterator[Path]:
    """Yield an empty file beside `path`; at the end it is flushed to the disk and replaces `path`.

    Its name is fixed, so that the next write removes what a killed process left. A file that was
    there keeps its mode.
    """
    aside = aside_of(path)
    try:
        try:
            # An existing file may be a link to a file elsewhere.
            aside.unlink(missing_ok=True)
            mode = path.stat().st_mode if path.is_file() and not path.is_symlink() else None
            made = open_regular(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL)
            try:
                if mode is not None and os.name != "nt":  # before anything is in it
                    os.fchmod(made, stat.S_IMODE(mode) | stat.S_IWUSR)
            finally:
                os.close(made)
            yield aside
            if mode is not None and aside.stat().st_mode != mode:
                aside.chmod(stat.S_IMODE(mode))
            with open(aside, "rb+") as file:
                os.fsync(file.fileno())
            os.replace(aside, path)
            _sync_folder(path.parent)
        except BaseException:
            with contextlib.suppress(OSError):
                aside.unlink(missing_ok=True)
            raise
    except OSError as error:
        if os.path.lexists(path):
            kept = f"The previous {path.name} is unchanged."
        else:
            kept = f"{path.name} did not exist before, and no part of it remains."
        raise cannot_write(path, error, kept) from error


def aside_of(path: Path) -> Path:
    """Return where the next version of `path` is written: in the same folder."""
    return path.with_name(path.name + ".aside")


def _sync_folder(folder: Path) -> None:
    """Make the renames in a folder durable, if the operating system supports that."""
    if os.name == "nt":  # Windows opens no folders; its renames are journalled
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError as error:
        # Some network and user-space file systems do not support fsync of folders.
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):
            raise
    finally:
        os.close(handle)


def make_inside(folder: Path, *names: str) -> Path:
    """Create the nested folders `names` in a folder; return the innermost.

    Those that exist are kept; none of them may be a link, except the outermost folder itself.
    """
    for name in names:
        (folder / name).mkdir(exist_ok=True)
        folder = existing_inside(folder, name)
    return folder


def existing_inside(folder: Path, *names: str) -> Path:
    """Return a folder in nested folders; none of those named may be a link."""
    for name in names:
        folder = folder / name
        if folder.is_symlink():
            raise RunError(f"{folder} is a link. Put the folder itself into the run.")
    return folder


def cannot_write(path: Path, error: OSError, kept: str) -> RunError:
    """Return the error for a write that failed; `kept` says what is left on the disk."""
    reason = error.strerror or str(error)
    advice = _ADVICE.get(error.errno or 0, "Correct that")
    return RunError(f"cannot write {path}: {reason}. {kept} {advice}, then try again.")


def json_text(value: object) -> str:
    """Return indented JSON that ends with a line break, of paths, enums and NumPy values, too.

    NaN and the infinities, which JSON cannot express, are a ValueError; see `finite`.
    """
    text = json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False, default=as_json)
    return text + "\n"


def finite(value: Any) -> Any:
    """Return JSON values, with null for NaN and the infinities, which JSON does not have."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_json(file: Path, advice: str) -> dict[str, Any]:
    """Read a file of at most 64 MiB that holds one JSON object; see `read_regular`."""
    try:
        content = json.loads(read_regular(file, 1 << 26, advice).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise RunError(f"{file} is damaged ({error}). {advice}") from error
    if not isinstance(content, dict):
        raise RunError(f"{file} is damaged (not a JSON object). {advice}")
    return content


def as_json(value: object) -> Any:
    """Return the JSON value of a NumPy value, an enum or a path, for `json.dumps`."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Path | np.dtype):
        return str(value)
    raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
