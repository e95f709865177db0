"""Engines: what runs the trials of a comparison, found by name.

An engine of another library is a function of the entry-point group `serp.engines`. It yields a
`concurrent.futures.Executor`, which most libraries for clusters have, so it takes a few lines.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from typing import Any, ClassVar, Final, Self

from pydantic import Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from serp._util.numbers import whole
from serp._util.plugins import find, loading, offered
from serp.comparison.plan import SettingChanges
from serp.comparison.workers import Job, Pool, Processes, portable
from serp.errors import RunError, SettingsError
from serp.settings.section import Section

GROUP: Final = "serp.engines"
"""Entry-point group of engines: functions of type `Engine`."""
LOCAL: Final = "local"
"""The engine of this library: processes of this machine."""

ONE_AFTER_ANOTHER: Final = (
    "The trials run one after another: the task has functions that cannot be imported from other "
    "processes (lambdas, or functions of a notebook or of __main__)."
)
"""What is said where jobs run in this process though several might run at the same time."""

Engine = Callable[[str | None, int | None], AbstractContextManager[Pool]]
"""(address of a cluster, most trials at the same time) → the workers, while the context lasts.

Without an address the engine starts workers on this machine. Without a number, as many trials run
at the same time as there are cores."""


@contextmanager
def open_pool(engine: str, address: str | None, most: int) -> Iterator[Pool]:
    """Yield the workers of an engine; see `serp.compare`.

    `most` is how many trials run at the same time, see `at_once`.

    Raises:
        RunError: The engine cannot be started.
        SettingsError: There is no such engine.
    """
    if engine != LOCAL:
        with find_engine(engine)(address, most or None) as pool:
            yield pool
        return
    with Processes(most) as processes:
        yield Pool(processes, most, processes.told)


def at_once(engine: str, asked: int | None, jobs: int) -> int:
    """Return how many of so many jobs run at the same time; 0 is for the engine to say."""
    return min(asked or os.cpu_count() or 1, jobs) if engine == LOCAL else asked or 0


def runs_here(engine: str, jobs: Sequence[Job], most: int) -> bool:
    """Return whether jobs run in this process.

    Those do of which one runs at a time: another process would only have to import and to load
    compiled code once more. So do those that cannot be sent to other processes.

    Args:
        engine: The engine.
        jobs: The jobs.
        most: What `at_once` returns.

    Raises:
        RunError: They cannot be sent to the workers, and the engine is not `local`.
    """
    if engine == LOCAL and most == 1:
        return True
    if portable(jobs):
        return False
    if engine != LOCAL:
        raise RunError(
            f"engine {engine}: the task has functions that cannot be imported on other machines "
            "(lambdas, or functions of a notebook or of __main__). Put them into a module that is "
            "installed there, or leave --engine out."
        )
    return True


def find_engine(name: str) -> Engine:
    """Return the engine of a name, which is not `local`; raise a SettingsError if there is none."""
    entry = find(offered(GROUP), name, "engine", SettingsError, known=[LOCAL])
    with loading(entry, "engine", SettingsError):
        engine: Engine = entry.load()
    return engine


class TrialsRequest(Section):
    """Options of whatever runs trials: their settings and seeds, and where they run.

    None stands for the default. An engine that cannot be found is refused, too.
    """

    first_seed: ClassVar[int] = 0
    """Where seeds begin of which only the number is given."""
    seeds: tuple[NonNegativeInt, ...] = ()
    settings: SettingChanges = Field(default_factory=dict)
    engine: str = LOCAL
    address: str | None = None
    jobs: PositiveInt | None = None
    quiet: bool = False

    @model_validator(mode="before")
    @classmethod
    def _given(cls, values: Mapping[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in values.items() if value is not None}

    @field_validator("seeds", mode="before")
    @classmethod
    def _seeds(cls, value: Any) -> Any:
        count = whole(value, 1)
        if count is not None:
            return tuple(range(cls.first_seed, cls.first_seed + count))
        seeds = tuple(value) if isinstance(value, Iterable) else ()
        if not seeds:
            raise ValueError("must be how many, at least 1, or a list such as [0, 7]")
        return tuple(dict.fromkeys(seeds))

    @model_validator(mode="after")
    def _found(self) -> Self:
        if self.engine != LOCAL:
            find_engine(self.engine)
        elif self.address is not None:
            raise ValueError("address is for an engine of a cluster, such as engine = 'ray'")
        return self
