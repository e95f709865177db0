"""A base class for context managers with a `close` method."""

from __future__ import annotations

import contextlib
from typing import Self

from serp.errors import SerpError


class Closing:
    """A context manager that calls `close` on exit; a subclass defines `close`.

    An error of `close` never hides an error of the body.
    """

    def close(self) -> None:
        """Release what is held; a second call does nothing."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        hidden = (SerpError, OSError) if kind is not None else ()
        with contextlib.suppress(*hidden):
            self.close()
