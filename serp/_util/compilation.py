"""Decorators that compile loops by numba, with a cache on disk.

A loop is compiled again when its own file was edited, or the constants, records and other loops
that it uses. Otherwise a loop could run with, for example, the memory layout of an earlier version.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator, Mapping
from numbers import Number
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

from numba import njit
from numba.core.ccallback import CFunc
from numba.core.sigutils import normalize_signature

from serp._util.code_cache import CodeCache

_Decorator = Callable[[Callable[..., Any]], Any]

_CONSTANTS: Final = (Number, str, tuple)
_stamps: dict[Callable[..., Any], str] = {}


def cached_njit(**options: Any) -> _Decorator:
    """Return a decorator that compiles a loop, with options of `numba.njit`.

    The machine code is cached on disk, see `serp._util.code_cache`; if that is impossible, every
    process compiles it again.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        return _kept(njit(**options)(function), function, options)

    return decorate


def cached_cfunc(signature: Any, **options: Any) -> _Decorator:
    """Return a decorator that compiles a C callback, with options of `numba.cfunc`."""

    def decorate(function: Callable[..., Any]) -> Any:
        # What `numba.cfunc` does, except that `numba.cfunc` compiles before a cache can be set. Its
        # `cache=True` would use numba's own cache, see `serp._util.code_cache`.
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
