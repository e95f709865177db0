"""Context managers that close themselves."""

from __future__ import annotations

import contextlib
from types import TracebackType
from typing import Self

from serp.errors import SerpError


class Closing:
    """A context manager that is closed at its end, and hides no error of its body by one of that.

    A subclass defines `close`.
    """

    def close(self) -> None:
        """Close it; a second call does nothing."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(SerpError, OSError):
            self.close()
