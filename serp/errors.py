"""The errors that a user of serp can meet.

Errors that a user can fix derive from :class:`SerpError`; the command line prints their text
without a traceback and exits with status 1. Errors in a domain file, which show the line, are in
`serp.pddl.source`. Any other exception that leaves serp is a bug.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class SerpError(Exception):
    """Base of all errors that say what is wrong with the input and what to do about it."""


def with_notes(error: BaseException, message: str = "") -> str:
    """Return the message of an error, or another one, and below it the notes of the error."""
    notes: list[str] = getattr(error, "__notes__", [])
    return "\n".join([message or str(error), *notes])


class TaskError(SerpError):
    """A task does not fit together: environment, domain, grounding or the map of actions."""


class EnvironmentFailure(TaskError):
    """The environment of a task raised, or returned something that its own spaces do not allow."""


class LearningFailure(SerpError):
    """A number of the learner is not finite, or too large for it."""


class RunError(SerpError):
    """A run folder or a checkpoint cannot be written, read or continued."""


class SettingsError(SerpError):
    """A setting has a value outside its range, or does not exist."""


class MissingExtra(SerpError):
    """An optional dependency is needed for what was asked."""

    def __init__(self, what: str, extra: str) -> None:
        super().__init__(f"{what} needs an optional part: pip install 'serp[{extra}]'")


@contextmanager
def needs_extra(extra: str, what: str) -> Iterator[None]:
    """Raise `MissingExtra` (`what` needs `extra`) where the body imports what is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "serp").partition(".")[0] == "serp":
            raise
        raise MissingExtra(what, extra) from error


class Interrupted(SerpError):
    """A training or a comparison was stopped by `signal`, a number; it can be continued."""

    def __init__(self, message: str, signal: int) -> None:
        super().__init__(message)
        self.signal = signal


class Notice(UserWarning):
    """Something that the user should know; the command prints it in one line."""
