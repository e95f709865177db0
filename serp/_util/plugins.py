"""Implementations found by name: entry points that installed packages declare."""

from __future__ import annotations

import functools
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from pathlib import Path
from typing import Final

from serp._util.did_you_mean import did_you_mean
from serp.errors import SerpError


def offered(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by name, without importing them."""
    return {entry.name: entry for entry in _declared(tuple(sys.path)).get(group, ())}


@functools.lru_cache(maxsize=4)
def _declared(places: tuple[str, ...]) -> dict[str, EntryPoints]:
    """Return the entry points of each group; reading them takes a while, and every agent asks."""
    everything = entry_points()
    groups = [group for group in everything.groups if group.startswith("serp.")]
    return {group: everything.select(group=group) for group in groups}


def find(
    entries: Mapping[str, EntryPoint],
    name: str,
    what: str,
    failure: type[SerpError],
    *,
    known: Iterable[str] = (),
    setting: str = "",
    advice: str = "",
) -> EntryPoint:
    """Return the entry point with a name; if there is none, raise a `failure`.

    For its message: `what` is the kind of implementation, such as `task`, `known` are other names
    to suggest, `setting` holds the name, and `advice` is the end.
    """
    if name not in entries:
        meant = did_you_mean(name, [*known, *entries]) or "none is installed"
        where = f"{setting}: " if setting else ""
        raise failure(f"{where}there is no {what} `{name}`; {meant}{advice}")
    return entries[name]


def loading(entry: EntryPoint, what: str, failure: type[SerpError]) -> AbstractContextManager[None]:
    """Raise a `failure` for anything but a `SerpError` that loading an entry point raises."""
    return blaming(f"{what} `{entry.name}` ({entry.value}) cannot be loaded", failure)


@contextmanager
def blaming(what: str, failure: type[SerpError]) -> Iterator[None]:
    """Raise a `failure` that begins with `what` for what is raised in the body.

    A `SerpError` and a `MemoryError` stay as they are.
    """
    try:
        yield
    except (SerpError, MemoryError):
        raise
    except Exception as error:
        raise failure(f"{what}: {type(error).__name__}: {error}") from error


_SERP: Final = str(Path(__file__).parents[1])


def raised(error: BaseException) -> str:
    """Return what an exception of a user's code says, and the line of that code which raised it."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.msg} ({error.filename}:{error.lineno}:{error.offset})"
    message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith(_SERP) and "importlib" not in frame.filename
    ]
    return f"{message} ({frames[-1].filename}:{frames[-1].lineno})" if frames else message


def first_line(implementation: object) -> str:
    """Return what an implementation is by the first line of its docstring; empty if it has none."""
    text = (implementation.__doc__ or "").strip().removeprefix("Return ")
    line = text.splitlines()[0].rstrip(".") if text else ""
    return line if line[1:2].isupper() else line[:1].lower() + line[1:]
