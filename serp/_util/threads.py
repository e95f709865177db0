"""Limits numerical libraries to one thread."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator

import threadpoolctl
import torch


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Limit torch and BLAS to one thread: in small networks more threads are slower."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpoolctl.threadpool_limits(1):
            yield
    finally:
        torch.set_num_threads(threads)


@functools.cache
def _libraries() -> threadpoolctl.ThreadpoolController:
    """Return the libraries that are loaded when this is first called; to find them takes 2 ms."""
    return threadpoolctl.ThreadpoolController()


@contextlib.contextmanager
def blas_on_one_thread() -> Iterator[None]:
    """Limit BLAS to one thread for a call in somebody else's loop, so that bits do not differ."""
    with _libraries().limit(limits=1, user_api="blas"):
        yield
