"""Finding a step of a recording: by its number, its time, or because it tells the most."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

import numpy as np

from serp.control.decision import Reason
from serp.errors import RunError
from serp.runs.recording import VETO_COLUMNS, Recording, vetoed
from serp.runs.recording_format import REASONS

_TIME: Final = re.compile(r"(?:(?:(\d+):)?(\d+):)?(\d+(?:\.\d+)?)")
_LARGEST: Final = 1e12


class FoundStep(NamedTuple):
    """A step of a recording, and why it is shown; empty where it was asked for."""

    step: int
    because: str = ""


def most_telling(recording: Recording) -> FoundStep:
    """Return the step of the newest veto; without one the newest unsafe step, else the last one.

    A veto for harm, risk or reward tells more than one of a proposal that is not applicable.

    Raises:
        RunError: There is no step yet.
    """
    columns = recording.columns(*VETO_COLUMNS, "unsafe")
    refused = vetoed(columns)
    applicable = columns["reason"] != REASONS.index(Reason.NOT_APPLICABLE)
    for what, steps in (
        ("refused proposal that was applicable", refused & applicable),
        ("unsafe step", columns["unsafe"]),
        ("refused proposal", refused),
    ):
        if steps.any():
            return FoundStep(int(np.flatnonzero(steps)[-1]), f"the last {what}")
    if not len(recording):
        recording.step(0)  # raises
    return FoundStep(len(recording) - 1, "the last step: nothing was refused, and nothing unsafe")


def seconds_of(text: str) -> float:
    """Return a time in seconds: `12.5`, `3:12`, `1:03:12`.

    Raises:
        RunError: It is no time.
    """
    match = _TIME.fullmatch(text.strip())
    if match is None:
        raise RunError(f"`{text}` is no time; write minutes:seconds, such as 3:12 or 1:03:12.5")
    hours, minutes, seconds = (float(part or 0) for part in match.groups())
    return min(_LARGEST, 3600 * hours + 60 * minutes + seconds)


def step_at(recording: Recording, episode: int, seconds: float) -> FoundStep:
    """Return the step of an episode in which a time falls, counted from the episode's beginning.

    Raises:
        RunError: There is no such episode, or it has ended by then.
    """
    period = recording.layout.control_period
    number = int(seconds / period + 1e-9) + 1
    recording.find(episode, 1)  # or there is no such episode
    count = len(recording.episodes[episode])
    if number > count:
        raise RunError(
            f"episode {episode:,} ends after {clock(count * period)} ({count:,} steps of "
            f"{period:g} s)."
        )
    return FoundStep(recording.find(episode, number))


def clock(seconds: float) -> str:
    """Return seconds as `3:12`, `1:03:12` or, where they are not whole, `3:12.46`."""
    hundredths = round(100 * seconds)
    minutes, rest = divmod(hundredths, 6000)
    hours, minutes = divmod(minutes, 60)
    text = f"{rest // 100:02}" + (f".{rest % 100:02}".rstrip("0") if rest % 100 else "")
    return f"{hours}:{minutes:02}:{text}" if hours else f"{minutes}:{text}"
