"""Python processes that this one starts: what they import, and when they end."""

from __future__ import annotations

import functools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    import threadpoolctl

_SAFE: Final = "PYTHONSAFEPATH"
_OURS: Final = "serp"
"""The value that says that the variable is ours; Python takes any."""


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module, and that imports nothing from the working folder."""
    return [sys.executable, "-P", "-m", module, *arguments]


@contextmanager
def safe_path() -> Iterator[None]:
    """Let the Python processes that begin meanwhile not search the working folder first.

    `multiprocessing` begins them by `python -c`, which would run a file `pickle.py` of that folder.
    Afterwards they search where this process does. What they start searches as ever, once they have
    called `unsafe_path`.
    """
    before = os.environ.get(_SAFE)
    os.environ[_SAFE] = before or _OURS
    try:
        yield
    finally:
        if not before:
            os.environ.pop(_SAFE, None)


def unsafe_path() -> None:
    """Take back, in a process that began in `safe_path`, what its own processes would inherit."""
    if os.environ.get(_SAFE) == _OURS:
        del os.environ[_SAFE]


def follow_parent() -> None:
    """Leave requests to end to the parent process, and end when it ends.

    Ctrl-C, a closed terminal and a scheduler signal every process of the group.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # Windows has not all of them
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS to one thread: more are slower, and how many there are changes bits."""
    import scipy.linalg  # noqa: F401  (a library that is loaded later is not limited)
    import threadpoolctl

    with threadpoolctl.threadpool_limits(1):
        yield


@functools.cache
def _libraries() -> threadpoolctl.ThreadpoolController:
    """Return the libraries that are loaded when this is first called; to find them takes 2 ms."""
    import scipy.linalg  # noqa: F401
    import threadpoolctl

    return threadpoolctl.ThreadpoolController()


@contextmanager
def blas_on_one_thread() -> Iterator[None]:
    """Limit BLAS to one thread for a call in somebody else's loop, so that bits do not differ."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield
