"""Compiling loops by numba, with a cache on disk wherever there can be one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def cached_njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a loop.

    The machine code is cached beside the source or in numba's cache folder; where neither can be
    written, it is compiled anew in every process.

    Args:
        options: Options of `numba.njit`.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        try:
            return njit(cache=True, **options)(function)
        except RuntimeError:  # numba found no folder that it may write
            return njit(**options)(function)

    return decorate
