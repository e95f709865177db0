"""The recorded steps as the page has them: arrays `[…, N]`, and texts that are there once."""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.terminal import visible
from serp._util.text import percent
from serp.agent.causes import Cause, Location
from serp.agent.decision import Reason
from serp.agent.refusals import schema_of
from serp.pddl.source import Source
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE
from serp.runs.recording_format import ACTORS, REASONS
from serp.runs.step_sentences import who_decided, why_refused
from serp.ui.report.recorded_steps import RecordedSteps
from serp.ui.report.scene import DrawnScenes
from serp.ui.report.tables import CauseTable, ModelErrors

_KEPT: Final = np.uint32(0xFFFFFF00)
"""Bits of a float32 that are kept: 15 of the 23 behind the binary point, more than four digits."""

Layout = list[tuple[str, str, int]]
"""Name, kind (`u1`, `u2`, `u4`, `f4`) and count of each array, in their order."""


def packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[str, Layout]:
    """Return arrays as text, and their layout.

    Unsigned integers of 1, 2 or 4 bytes are kept exactly; all other numbers become float32 with at
    least four significant digits. Of each array the first bytes of all numbers come first, then the
    second bytes, and so on: equal bytes that follow one another pack well.
    """
    layout: Layout = []
    parts = []
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).ravel()
        if flat.dtype.kind != "u" or flat.dtype.itemsize > 4:
            flat = _rounded(flat)
        little = flat.astype(flat.dtype.newbyteorder("<"))
        layout.append((name, f"{little.dtype.kind}{little.itemsize}", len(little)))
        parts.append(little.view(np.uint8).reshape(-1, little.itemsize).T.tobytes())
    # mtime=0: equal data give equal bytes
    return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode("ascii"), layout


def _rounded(numbers: NDArray[Any]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):  # beyond the range of float32 it is infinite
        single = numbers.astype(np.float32)
    bits = single.view(np.uint32)
    half = np.where(np.isfinite(single), np.uint32(0x80), np.uint32(0))
    rounded: NDArray[np.float32] = ((bits + half) & _KEPT).view(np.float32)
    return rounded


VETOED, UNSAFE, NO_SAFE, INDIFFERENT, LARGE_ERROR, DRAWN = (1 << k for k in range(6))
"""Bits of a step; `page/replay.js` has the same."""
UNMODELLED: Final = 128
"""Beside the flags of an alternative: the model does not know the action."""
_NONE, _ALL_SAFE = 0xFFFF, 0xFFFE
_LABELS: Final = {
    "reward": "reward",
    "unsafe": "unsafe",
    "risk": "risk",
    "end": "ends the task",
    "failed": "not applicable",
    "conflict": "contradicts another effect",
    "undefined": "has no value",
}
_SHOWN: Final = ("kind", "label", "by", "text", "condition", "comment", "place", "line")
Arrays = dict[str, NDArray[Any]]


def step_arrays(steps: RecordedSteps, errors: ModelErrors, drawn: NDArray[np.bool_]) -> Arrays:
    """Return what is shown of steps, fluents `[F, N]` and alternatives `[A, N]`.

    `drawn` `[N]` tells which steps have a picture.
    """
    bits = (
        VETOED * steps.vetoed
        + UNSAFE * steps["unsafe"]
        + NO_SAFE * steps.no_safe
        + INDIFFERENT * steps["indifferent"]
        + LARGE_ERROR * (errors.largest >= errors.limit)
        + DRAWN * drawn
    )
    flags = (steps["flags"] & 0xFF) | (UNMODELLED * (steps["ground"] < 0))
    ends = [rows.stop - 1 for rows in steps.rows]
    safe = steps["safe_steps"]
    safe = np.where(safe == SAFE, _ALL_SAFE, np.where(safe < 0, _NONE, np.minimum(safe, 60_000)))
    return {
        "position": steps.positions.astype(np.uint32),
        "bits": bits.astype(np.uint8),
        "executed": steps["action"].astype(np.uint16),
        "proposed": np.where(steps["proposed"] < 0, _NONE, steps["proposed"]).astype(np.uint16),
        "executedBy": steps["executed_by"],
        "reason": steps["reason"],
        "error": errors.largest,
        "state": steps["state"].T,
        "last": steps.next_states[ends].T,
        "predicted": errors.predicted.T,
        "errors": errors.errors.T,
        "value": steps["value"].T,
        "reward": steps["reward"].T,
        "safe": safe.T.astype(np.uint16),
        "flags": flags.T.astype(np.uint8),
    }


def cause_arrays(causes: CauseTable) -> Arrays:
    """Return the entries of all causes."""
    return {
        "causeAt": causes.at,
        "causeAction": causes.action,
        "cause": causes.cause,
        "amount": causes.amount,
    }


def risk_data(steps: RecordedSteps, causes: CauseTable) -> tuple[Arrays, list[str]]:
    """Return all risks as texts, and the arrays that hold their positions among these.

    `risk` is that of the path by each alternative, and `causeRisk` that of each entry of a cause.
    """
    texts: dict[str, int] = {}
    arrays = {}
    risky = np.array([cause.what == "risk" for cause in causes.causes], np.bool_)[causes.cause]
    own = np.where(risky, causes.amount, 0.0)
    for name, shares in (("risk", steps["path_risk"].T), ("causeRisk", own)):
        distinct, at = np.unique(shares, return_inverse=True)
        numbers = [texts.setdefault(percent(each), len(texts)) for each in distinct.tolist()]
        arrays[name] = np.array(numbers, np.uint16)[at].reshape(shares.shape)
    return arrays, list(texts)


def cause_data(causes: CauseTable, sources: tuple[Source, ...]) -> list[dict[str, str]]:
    """Return every distinct cause as JSON values."""
    return [shown_cause(cause, sources) for cause in causes.causes]


def shown_cause(cause: Cause | None, sources: tuple[Source, ...]) -> dict[str, str]:
    """Return the texts about a cause, empty for none; `line` is the id of its line in the page."""
    if cause is None:
        return dict.fromkeys(_SHOWN, "")
    learned = cause.origin == "learned"
    texts = (
        cause.what,
        _LABELS[cause.what],
        "what the run has learned" if learned else schema_of(cause),
        cause.text,
        cause.condition,
        cause.comment,
        "" if cause.place is None else f"{Path(cause.place.file).name}:{cause.place.line}",
        _line_id(cause.place, sources),
    )
    return dict(zip(_SHOWN, map(visible, texts), strict=True))


def _line_id(place: Location | None, sources: tuple[Source, ...]) -> str:
    """Return the id of a line in the page; empty where it is not there."""
    for number, source in enumerate(sources):
        if place is not None and place.file == source.name:
            return f"f{number}-{place.line}"
    return ""


def told_of(steps: RecordedSteps, actions: list[str]) -> Arrays:
    """Return the distinct sentences about decisions, a line each, and `told`: that of each step.

    What of the file is behind a refusal stands beside them, with its place.
    """
    numbers: dict[str, int] = {}
    found = []
    for step, vetoed in enumerate(steps.vetoed.tolist()):
        reason = Reason(REASONS[steps["reason"][step]])
        proposed, executed = int(steps["proposed"][step]), int(steps["action"][step])
        why = ""
        if vetoed and proposed >= 0:
            safe = int(steps["safe_steps"][step, proposed])
            reward = float(steps["reward"][step, proposed])
            known = reason is Reason.UNSAFE_AHEAD and 0 <= safe < SAFE
            why = why_refused(reason, (), reward, safe if known else None)
        sentences = who_decided(
            reason,
            (actions[proposed] if proposed >= 0 else "", ACTORS[steps["proposed_by"][step]]),
            (actions[executed], ACTORS[steps["executed_by"][step]]),
            rho=math.nan,
            indifferent=bool(steps["indifferent"][step]),
            bound=Bound(int(steps["bound"][step])),
            why=why,
        )
        found.append(numbers.setdefault(" ".join(sentences), len(numbers)))
    text = "\n".join(numbers).encode()
    return {"told": np.array(found, np.uint32), "sentences": np.frombuffer(text, np.uint8)}


def episode_data(steps: RecordedSteps, scenes: DrawnScenes) -> list[dict[str, Any]]:
    """Return the episodes as JSON values."""
    found = []
    for episode, rows in zip(steps.episodes, steps.rows, strict=True):
        frame, frames = scenes.frames.get(episode.number, (0, 0))
        found.append(
            {
                "number": episode.number,
                "first": rows.start,
                "steps": len(episode),
                "return": episode.return_,
                "end": episode.end + (f", {episode.cut:,} steps left out" if episode.cut else ""),
                "vetoes": episode.vetoes,
                "frame": frame,
                "frames": frames,
                "note": scenes.notes.get(episode.number, ""),
            }
        )
    return found
