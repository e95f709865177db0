"""Compiling loops by numba, with a cache on disk wherever there can be one.

Numba takes what it has cached for fresh while the file of the loop is as it was. A loop is made of
more: constants and other loops that its module imports. They are put beside numba's own stamp, so
that no loop of an earlier version is run with, say, the layout of memory that was edited since.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Iterator
from numbers import Number
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, Final

from numba import njit
from numba.core.ccallback import CFunc
from numba.core.sigutils import normalize_signature

_Decorator = Callable[[Callable[..., Any]], Any]

_CONSTANTS: Final = (Number, str, tuple)
_stamps: dict[Callable[..., Any], str] = {}


def cached_njit(**options: Any) -> _Decorator:
    """Return a decorator that compiles a loop.

    The machine code is cached beside the source or in numba's cache folder; where neither can be
    written, it is compiled anew in every process.

    Args:
        options: Options of `numba.njit`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        _stamps[function] = _stamp_of(function)
        try:
            return _stamped(njit(cache=True, **options)(function), function)
        except RuntimeError:  # numba found no folder that it may write
            return njit(**options)(function)

    return decorate


def cached_cfunc(signature: Any, **options: Any) -> _Decorator:
    """Return a decorator that compiles a C callback, cached like a loop.

    Args:
        signature: Its numba signature.
        options: Options of `numba.cfunc`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        _stamps[function] = _stamp_of(function)
        # As `numba.cfunc` does, which would look into the cache before there is a stamp.
        types: Any = normalize_signature(signature)  # type: ignore[no-untyped-call]
        callback = CFunc(function, types, locals={}, options=options)
        try:
            callback.enable_caching()
        except RuntimeError:  # as above
            pass
        else:
            _stamped(callback, function)
        callback.compile()
        return callback

    return decorate


def _stamped(compiled: Any, function: Callable[..., Any]) -> Any:
    """Put a loop's stamp beside that of numba; there is none where it was told not to compile."""
    if hasattr(compiled, "_cache"):
        file = compiled._cache._cache_file
        file._source_stamp = (file._source_stamp, _stamps[function])
    return compiled


def _stamp_of(function: Callable[..., Any]) -> str:
    """Return a digest of what a loop is made of."""
    code: CodeType = function.__code__
    digest = hashlib.sha256(_source(code.co_filename))
    for part in _parts(set(_names(code)), function.__globals__):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()


def _parts(names: set[str], known: dict[str, Any]) -> Iterator[str]:
    for name in sorted(names & known.keys()):
        value = known[name]
        if isinstance(value, _CONSTANTS):
            yield f"{name}={value!r}"
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
    path = Path(file)
    return path.read_bytes() if path.is_file() else b""
