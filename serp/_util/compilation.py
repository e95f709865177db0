"""Decorators that compile loops by numba, with a cache on disk.

A loop is compiled again when its own file was edited, or the constants, records and other loops
that it uses. Otherwise a loop could run with, for example, the memory layout of an earlier version.
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
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from numbers import Number
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

import numba
import platformdirs
from numba import njit
from numba.core import event
from numba.core.caching import CompileResultCacheImpl, NullCache
from numba.core.ccallback import CFunc
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from serp.errors import Notice


class _CompileTimer(event.Listener):
    """Adds up the time of compilation; nested compilations count once."""

    def __init__(self) -> None:
        self.on_begin: Callable[[], None] | None = None
        self._lock = threading.Lock()
        self._depth = 0
        self._begin = 0.0
        self._total = 0.0

    @property
    def seconds(self) -> float:
        with self._lock:
            running = time.monotonic() - self._begin if self._depth else 0.0
            return self._total + running

    def on_start(self, event: Any) -> None:
        with self._lock:
            self._depth += 1
            if self._depth > 1:
                return
            self._begin = time.monotonic()
        if self.on_begin is not None:
            self.on_begin()

    def on_end(self, event: Any) -> None:
        with self._lock:
            self._depth -= 1
            if not self._depth:
                self._total += time.monotonic() - self._begin


_TIMER: Final = _CompileTimer()
# The compilation of a callback raises no `numba:compile` event, but its passes do raise theirs.
# Neither event is raised when machine code is read from disk.
for _kind in ("numba:compile", "numba:run_pass"):
    event.register(_kind, _TIMER)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Return the seconds that this process has spent compiling."""
    return _TIMER.seconds


def working_time() -> float:
    """Return the time of a monotonic clock, in seconds, that stops during compilation."""
    return time.monotonic() - _TIMER.seconds


@contextmanager
def notifying_of_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call a function whenever the compilation of a loop begins."""
    before, _TIMER.on_begin = _TIMER.on_begin, tell
    try:
        yield
    finally:
        _TIMER.on_begin = before


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


_Decorator = Callable[[Callable[..., Any]], Any]

_CONSTANTS: Final = (Number, str, tuple)
_stamps: dict[Callable[..., Any], str] = {}


def cached_njit(**options: Any) -> _Decorator:
    """Return a decorator that compiles a loop, with options of `numba.njit`.

    The machine code is cached on disk, see `serp._util.compilation`; if that is impossible, every
    process compiles it again.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        return _kept(njit(**options)(function), function, options)

    return decorate


def cached_cfunc(signature: Any, **options: Any) -> _Decorator:
    """Return a decorator that compiles a C callback, with options of `numba.cfunc`."""

    def decorate(function: Callable[..., Any]) -> Any:
        # What `numba.cfunc` does, except that `numba.cfunc` compiles before a cache can be set. Its
        # `cache=True` would use numba's own cache, see `serp._util.compilation`.
        types: Any = normalize_signature(signature)  # type: ignore[no-untyped-call]
        callback = _kept(CFunc(function, types, locals={}, options=options), function, options)
        callback.compile()
        return callback

    return decorate


def _kept(compiled: Any, function: Callable[..., Any], options: Mapping[str, Any]) -> Any:
    """Set the cache of a loop; a loop that numba was told not to compile needs none."""
    stamp = _stamps[function] = _stamp_of(function, options)
    if hasattr(compiled, "_cache") and function.__closure__ is None:
        compiled._cache = CodeCache(function, stamp)
    return compiled


def _stamp_of(function: Callable[..., Any], options: Mapping[str, Any]) -> str:
    """Return a digest of everything that a loop is compiled from."""
    code: CodeType = function.__code__
    digest = hashlib.sha256(_source(code.co_filename))
    # The order of a set of strings differs from process to process.
    plain = {k: sorted(v) if isinstance(v, set) else v for k, v in options.items()}
    digest.update(repr(sorted(plain.items())).encode())
    # Everything that the module imports counts: a loop may call one that is defined after it.
    names = {name for name in function.__globals__ if not name.startswith("__")}
    for part in _parts(names | set(_names(code)), function.__globals__):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()


def _parts(names: set[str], known: dict[str, Any]) -> Iterator[str]:
    for name in sorted(names & known.keys()):
        value = known[name]
        if isinstance(value, _CONSTANTS):
            yield f"{name}={value!r}"
        elif isinstance(value, type) and issubclass(value, tuple):
            yield f"{name}={getattr(value, '_fields', ())!r}"
        elif isinstance(value, ModuleType):
            yield from _parts(names, {
                other: one for other, one in vars(value).items() if isinstance(one, _CONSTANTS)
            })  # fmt: skip
        elif (loop := getattr(value, "py_func", None)) in _stamps:
            yield f"{name}={_stamps[loop]}"
        elif (made := getattr(value, "_defn", None)) is not None:  # an intrinsic
            yield f"{name}={hashlib.sha256(_source(made.__code__.co_filename)).hexdigest()}"


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _names(inner)


@functools.cache
def _source(file: str) -> bytes:
    """Return the text of a module; a compiled model has none."""
    path = Path(file)
    return path.read_bytes() if path.is_file() else b""
