"""Engines, which run the trials of a comparison: here, or on the machines of a cluster."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import AbstractContextManager
from typing import Final

from serp._util.plugins import find, loading, offered
from serp.errors import SettingsError

GROUP: Final = "serp.engines"
"""Entry-point group of engines: functions of type `Engine`."""
LOCAL: Final = "local"
"""The engine of this library: processes of this machine."""

Engine = Callable[[str | None, int | None], AbstractContextManager[tuple[Executor, int]]]
"""(address of a cluster, most trials at the same time) → an executor and how many trials it runs.

Without an address the engine starts workers on this machine. Without a number, as many trials run
at the same time as there are cores."""


def find_engine(name: str) -> Engine:
    """Return the engine of a name, which is not `local`; raise a SettingsError if there is none."""
    entry = find(offered(GROUP), name, "engine", SettingsError, known=[LOCAL])
    with loading(entry, "engine", SettingsError):
        engine: Engine = entry.load()
    return engine
