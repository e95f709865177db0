"""Waiting for files to change."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from serp.model.loading import problem_beside

_SECONDS = 0.2


def changes(domains: Sequence[Path]) -> Iterator[None]:
    """Yield at once, and then whenever one of some files, or a problem beside it, is written.

    The times of a handful of files are looked at five times a second, which costs nothing and works
    on every disk.
    """
    watched = list(dict.fromkeys(p for path in domains for p in (path, problem_beside(path))))
    before: list[tuple[int, int]] | None = None
    while True:
        now = [_state(path) for path in watched]
        if now != before:
            before = now
            yield
        time.sleep(_SECONDS)


def _state(path: Path) -> tuple[int, int]:
    try:
        found = path.stat()
    except OSError:
        return -1, -1
    return found.st_mtime_ns, found.st_size
