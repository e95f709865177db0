"""Optional libraries: if one is missing, the message names the extra that installs it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from serp.errors import MissingExtra


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Raise `MissingExtra` where the body imports an optional library that is not installed.

    `extra` installs it; the message begins with `what` needs it.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "serp").partition(".")[0] == "serp":
            raise
        raise MissingExtra(what, extra) from error
