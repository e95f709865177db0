"""A cache of compiled code on disk: a file for each loop and signature, checked before use.

Numba's own cache knows neither edits of what a loop calls nor functions without a file, such as
models, and offers no public interface for another one: hence its internal classes here.

Its files are pickles of machine code, as numba hands it over: whoever can write
into the folder can let code run as the user. The folder is therefore made for its owner alone, and
one that others can write is not used. A file that was cut or damaged is noticed by its digest
before any of it is read; it is removed, and the loop compiled anew.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import pickle
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numba
import platformdirs
from numba.core.caching import CompileResultCacheImpl, NullCache
from numba.core.serialize import dumps

from serp.errors import Notice

_MAGIC: Final = b"serp compiled code 1\n"
_DIGEST: Final = 32
_OTHERS_WRITE: Final = stat.S_IWGRP | stat.S_IWOTH


def cache_folder() -> Path:
    """Return the folder of compiled code: $SERP_CACHE_DIR, or one in the user's cache folder."""
    chosen = os.environ.get("SERP_CACHE_DIR")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("serp")) / "compiled"


@functools.cache
def _trusted(folder: Path) -> bool:
    """Make the folder where it is missing; return whether nobody else can write into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        _say(f"compiled code cannot be kept in {folder} ({error.strerror})")
        return False
    if sys.platform == "win32":  # users' folders there are their own
        return True
    if found.st_uid not in (os.getuid(), 0):
        _say(f"compiled code is not kept in {folder}, which belongs to another user")
        return False
    if found.st_mode & _OTHERS_WRITE:
        _say(f"compiled code is not kept in {folder}, which others can write: chmod go-w {folder}")
        return False
    return True


class _Form(CompileResultCacheImpl):
    """Numba's own form of what is kept, without its ideas of where."""

    def __init__(self) -> None:
        pass

    def check_cachable(self, data: Any) -> bool:
        return not (data.lifted or data.library.has_dynamic_globals)


class CodeCache(NullCache):
    """The compiled code of one function, in the place of numba's own cache.

    Args:
        function: The function. Its module and its name say where its code is kept.
        stamp: Digest of what it is made of; code with another one is compiled anew.
    """

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        self._name = function.__name__
        file = function.__code__.co_filename
        # A model, which has no file, is told apart by what stands for one. Copies of a module share
        # a place, so that the folder does not grow with every checkout; the stamp tells them apart.
        model = file if file.startswith("<") else ""
        self._place = (function.__module__, model, function.__qualname__)
        self._stamp = hashlib.sha256(stamp.encode()).digest()
        self._form: Any = _Form()
        self._folder = cache_folder()

    @property
    def cache_path(self) -> str:
        """The folder, as numba's statistics have it."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature; None where there is none that can be used."""
        target_context.refresh()
        if not _trusted(self._folder):
            return None
        file = self._file(sig, target_context.codegen())
        try:
            content = file.read_bytes()
        except OSError:
            return None
        try:
            payload = self._payload(content)
            if payload is None:
                return None
            return self._form.rebuild(target_context, pickle.loads(payload))
        except Exception:  # a pickle that does not fit may raise anything
            with contextlib.suppress(OSError):
                file.unlink()
            _say(f"compiled code in {self._folder} was damaged; it is compiled anew")
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for a signature, where that is possible."""
        if not _trusted(self._folder) or not self._form.check_cachable(data):
            return
        payload: bytes = dumps(self._form.reduce(data))  # type: ignore[no-untyped-call]
        content = _MAGIC + self._stamp + hashlib.sha256(payload).digest() + payload
        with contextlib.suppress(OSError):  # a full disk, or a folder for reading only
            _write(self._file(sig, data.codegen), content)

    def _payload(self, content: bytes) -> bytes | None:
        """Return the pickle within a file; None where it is of another version of the function.

        Raises:
            ValueError: The file was cut or altered.
        """
        body = content.removeprefix(_MAGIC)
        stamp, digest, payload = body[:_DIGEST], body[_DIGEST : 2 * _DIGEST], body[2 * _DIGEST :]
        if not content.startswith(_MAGIC) or hashlib.sha256(payload).digest() != digest:
            raise ValueError("it is cut or altered")
        return payload if stamp == self._stamp else None

    def _file(self, sig: Any, codegen: Any) -> Path:
        """Return where the code for a signature lies, apart for each kind of machine and numba."""
        made_for = (sig, codegen.magic_tuple(), numba.__version__, sys.implementation.cache_tag)
        digest = hashlib.sha256(repr((self._place, made_for)).encode()).hexdigest()
        return self._folder / f"{self._name}-{digest[:32]}.code"


def _write(file: Path, content: bytes) -> None:
    """Replace a file in one step: other processes may be reading it."""
    with tempfile.NamedTemporaryFile(dir=file.parent, delete=False) as aside:
        try:
            aside.write(content)
            aside.flush()
            os.replace(aside.name, file)
        except OSError:
            os.unlink(aside.name)
            raise


@functools.cache
def _say(text: str) -> None:
    """Say something once."""
    warnings.warn(text, Notice, stacklevel=2)
