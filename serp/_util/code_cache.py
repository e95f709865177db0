"""A cache of compiled code on disk: a file for each loop and signature, checked before use.

Numba's own cache does not notice edits of the functions that a loop calls. It does not support
functions without a source file, such as compiled models. It has no public interface for another
cache, so this module uses its internal classes.

The files are pickles of machine code, made by numba: whoever can write to the folder can run code
as the user. The folder is therefore created with access for its owner only, and a folder that
others can write to is not used. A digest detects a truncated or damaged file before it is
unpickled; the file is removed, and the loop is compiled again.
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


def cache_folder() -> Path:
    """Return the folder of compiled code: $SERP_CACHE_DIR, or one in the user's cache folder."""
    chosen = os.environ.get("SERP_CACHE_DIR")
    return Path(chosen) if chosen else Path(platformdirs.user_cache_dir("serp")) / "compiled"


@functools.cache
def _is_private(folder: Path) -> bool:
    """Create the folder if it is missing; return whether only its owner can write to it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
    except OSError as error:
        problem = f"compiled code cannot be kept in {folder} ({error.strerror})"
    else:
        if sys.platform == "win32":  # the user's cache folder is private there
            return True
        problem = ""
        if found.st_uid not in (os.getuid(), 0):
            problem = f"compiled code is not kept in {folder}, which belongs to another user"
        elif found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            advice = f"chmod go-w {folder}"
            problem = f"compiled code is not kept in {folder}, which others can write: {advice}"
    if problem:
        warnings.warn(problem, Notice, stacklevel=2)
    return not problem


class _Serialisation(CompileResultCacheImpl):
    """Numba's serialisation of compiled code, without its choice of a folder."""

    def __init__(self) -> None:
        pass

    def check_cachable(self, data: Any) -> bool:
        return not (data.lifted or data.library.has_dynamic_globals)


class CodeCache(NullCache):
    """The cached code of one function, in place of numba's own cache.

    Its module and its name determine the file. Code of which the sources had another digest
    (`stamp`) is compiled again.
    """

    def __init__(self, function: Callable[..., Any], stamp: str) -> None:
        self._name = function.__name__
        file = function.__code__.co_filename
        # A model has no source file; its file name `<...>` identifies it. Copies of a module share
        # a cache file, so that the folder does not grow with every checkout; their stamps differ.
        model = file if file.startswith("<") else ""
        self._place = (function.__module__, model, function.__qualname__)
        self._head = _MAGIC + hashlib.sha256(stamp.encode()).digest()
        self._serialisation: Any = _Serialisation()
        self._folder = cache_folder()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for a signature; None if no usable code is stored."""
        target_context.refresh()
        if not _is_private(self._folder):
            return None
        file = self._file(sig, target_context.codegen())
        try:
            content = file.read_bytes()
        except OSError:
            return None
        begin = len(self._head) + _DIGEST
        digest, payload = content[len(self._head) : begin], content[begin:]
        try:
            if not content.startswith(_MAGIC) or hashlib.sha256(payload).digest() != digest:
                raise ValueError("truncated or altered")
            if not content.startswith(self._head):  # of another version of the function
                return None
            return self._serialisation.rebuild(target_context, pickle.loads(payload))
        except Exception:  # an incompatible pickle may raise anything
            with contextlib.suppress(OSError):
                file.unlink()
            _warn_of_damage(self._folder)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the code for a signature, if possible."""
        if not _is_private(self._folder) or not self._serialisation.check_cachable(data):
            return
        payload: bytes = dumps(self._serialisation.reduce(data))  # type: ignore[no-untyped-call]
        content = self._head + hashlib.sha256(payload).digest() + payload
        with contextlib.suppress(OSError):  # a full disk, or a read-only folder
            _write(self._file(sig, data.codegen), content)

    def _file(self, sig: Any, codegen: Any) -> Path:
        """Return the file for a signature on this kind of machine and with this numba version."""
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
def _warn_of_damage(folder: Path) -> None:
    text = f"compiled code in {folder} was damaged; it is compiled again"
    warnings.warn(text, Notice, stacklevel=2)
