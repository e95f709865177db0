"""The recorded steps as the page has them: arrays `[…, N]`, and texts that are there once."""

from __future__ import annotations

import base64
import gzip
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp._util.terminal import visible
from serp.agent.causes import Cause
from serp.agent.decision import Reason
from serp.agent.sentences import who_decided, why_refused
from serp.pddl.source import Source
from serp.planning.forecast import SAFE, Bound
from serp.runs.recording import ACTORS, REASONS
from serp.ui.report.recorded_steps import RecordedSteps
from serp.ui.report.scene import DrawnScenes
from serp.ui.report.tables import CauseTable, ModelErrors

Layout = list[tuple[str, str, int]]
"""Name, kind (`u1`, `u2`, `u4`, `f4`) and count of each array, in their order."""


def packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[str, Layout]:
    """Return arrays as text, and their layout.

    Unsigned integers of 1, 2 or 4 bytes are kept exactly; all other numbers become float32 with at
    least four significant digits. Of each array the first bytes of all numbers come first, then the
    second bytes, and so on: equal bytes that follow one another pack well.
    """
    # Bits of a float32 that are retained: 15 of 23 after the binary point, more than four digits.
    retained = np.uint32(0xFFFFFF00)
    layout: Layout = []
    parts = []
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).ravel()
        if flat.dtype.kind != "u" or flat.dtype.itemsize > 4:
            with np.errstate(over="ignore"):  # beyond the range of float32 it is infinite
                flat = flat.astype(np.float32)
            half = np.where(np.isfinite(flat), np.uint32(0x80), np.uint32(0))
            flat = ((flat.view(np.uint32) + half) & retained).view(np.float32)
        little = flat.astype(flat.dtype.newbyteorder("<"))
        layout.append((name, f"{little.dtype.kind}{little.itemsize}", len(little)))
        parts.append(little.view(np.uint8).reshape(-1, little.itemsize).T.tobytes())
    # mtime=0: equal data give equal bytes
    return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode("ascii"), layout


VETOED, UNSAFE, NO_SAFE, LARGE_ERROR, DRAWN = (1 << k for k in range(5))
"""Bits of a step; `page/replay.js` has the same."""
_LABELS: Final = {
    "reward": "reward",
    "unsafe": "unsafe",
    "risk": "risk",
    "end": "ends the task",
    "failed": "not applicable",
    "conflict": "contradicts another effect",
    "undefined": "has no value",
}
Arrays = dict[str, NDArray[Any]]


def step_arrays(
    steps: RecordedSteps, errors: ModelErrors, causes: CauseTable, drawn: NDArray[np.bool_]
) -> Arrays:
    """Return what is shown of steps, fluents `[F, N]`, alternatives `[A, N]` and causes.

    `drawn` `[N]` is whether steps have a picture.
    """
    none = 0xFFFF
    bits = (
        VETOED * steps.vetoed
        + UNSAFE * steps["unsafe"]
        + NO_SAFE * steps.no_safe
        + LARGE_ERROR * (errors.largest >= errors.limit)
        + DRAWN * drawn
    )
    # 128: the model does not know the action.
    flags = (steps["flags"] & 0xFF) | (128 * (steps["ground"] < 0))
    ends = [rows.stop - 1 for rows in steps.rows]
    safe = steps["safe_steps"]
    safe = np.where(safe == SAFE, 0xFFFE, np.where(safe < 0, none, np.minimum(safe, 60_000)))
    return {
        "position": steps.positions.astype(np.uint32),
        "bits": bits.astype(np.uint8),
        "executed": steps["action"].astype(np.uint16),
        "proposed": np.where(steps["proposed"] < 0, none, steps["proposed"]).astype(np.uint16),
        "executedBy": steps["executed_by"],
        "reason": steps["reason"],
        "state": steps["state"].T,
        "last": steps["next_state"][ends].T,
        "predicted": errors.predicted.T,
        "errors": errors.errors.T,
        "value": steps["value"].T,
        "reward": steps["reward"].T,
        "risk": steps["path_risk"].T,
        "safe": safe.T.astype(np.uint16),
        "flags": flags.T.astype(np.uint8),
        "causeAt": causes.at,
        "causeAction": causes.action,
        "cause": causes.cause,
        "amount": causes.amount,
    }


def picture_arrays(pictures: list[bytes]) -> Arrays:
    """Return the bytes of all pictures, and where each begins and ends."""
    ends = np.cumsum([0, *map(len, pictures)]).astype(np.uint32)
    return {"pictures": np.frombuffer(b"".join(pictures), np.uint8), "pictureAt": ends}


def shown_cause(cause: Cause, sources: Sequence[Source]) -> dict[str, str]:
    """Return the texts about a cause; `line` is the id of its line in the page, or empty."""
    line, place = "", cause.place
    if place is not None:
        numbers = [number for number, source in enumerate(sources) if source.name == place.file]
        line = f"f{numbers[0]}-{place.line}" if numbers else ""
    texts = {
        "kind": cause.what,
        "label": _LABELS[cause.what],
        "by": "what the run has learned" if cause.origin == "learned" else cause.schema,
        "text": cause.text,
        "condition": cause.condition,
        "comment": cause.comment,
        "place": "" if place is None else f"{Path(place.file).name}:{place.line}",
        "line": line,
    }
    return {name: visible(text) for name, text in texts.items()}


def decision_arrays(steps: RecordedSteps, actions: list[str]) -> Arrays:
    """Return the distinct sentences about decisions, a line each, and the number of each step's.

    What of the file is behind a refusal stands beside them, with its place.
    """
    numbers: dict[str, int] = {}
    of_step = []
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
        of_step.append(numbers.setdefault(" ".join(sentences), len(numbers)))
    text = "\n".join(numbers).encode()
    return {"sentence": np.array(of_step, np.uint32), "sentences": np.frombuffer(text, np.uint8)}


def episode_data(steps: RecordedSteps, scenes: DrawnScenes) -> list[dict[str, Any]]:
    """Return the episodes as JSON values."""
    data = []
    for episode, rows in zip(steps.episodes, steps.rows, strict=True):
        frame, frames = scenes.frames.get(episode.number, (0, 0))
        data.append(
            {
                "number": episode.number,
                "first": rows.start,
                "steps": len(episode),
                "return": episode.return_,
                "end": episode.end,
                "vetoes": episode.vetoes,
                "frame": frame,
                "frames": frames,
                "note": scenes.notes.get(episode.number, ""),
            }
        )
    return data
