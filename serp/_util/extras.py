"""Optional libraries: if one is missing, the message names the extra that installs it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from serp.errors import MissingExtra


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Guard imports of optional libraries.

    Args:
        extra: The extra of this package that installs them, such as `plots`.
        what: What needs them; the message begins with it.

    Raises:
        MissingExtra: A library imported in the body is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "serp").partition(".")[0] == "serp":
            raise
        raise MissingExtra(what, extra) from error
