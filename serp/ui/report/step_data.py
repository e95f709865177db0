"""The recorded steps as the page has them: arrays `[…, N]`, and texts that are there once."""

from __future__ import annotations

import base64
import gzip
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp.planning.forecast import SAFE
from serp.ui.report.recorded_steps import RecordedSteps
from serp.ui.report.scene import DrawnScenes
from serp.ui.report.step_accounts import ModelErrors, StepAccounts

Layout = list[tuple[str, str, int]]
"""Name, kind (`u1`, `u2`, `u4`, `f4`) and count of each array, in their order."""


def packed(arrays: Mapping[str, NDArray[Any]]) -> tuple[str, Layout]:
    """Return arrays as text, and their layout.

    Unsigned integers of 1, 2 or 4 bytes are kept exactly; all other numbers become float32 with at
    least four significant digits, which pack better. Their bytes are little-endian.
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
        parts.append(little.tobytes())
    # mtime=0: equal data give equal bytes
    return base64.b64encode(gzip.compress(b"".join(parts), 6, mtime=0)).decode("ascii"), layout


VETOED, UNSAFE, NO_SAFE, LARGE_ERROR = (1 << k for k in range(4))
"""Bits of a step; `templates/replay.js` has the same."""


def step_arrays(
    steps: RecordedSteps, errors: ModelErrors, accounts: StepAccounts
) -> dict[str, NDArray[Any]]:
    """Return what is shown of steps, fluents `[F, N]`, alternatives `[A, N]` and causes."""
    none = 0xFFFF
    bits = (
        VETOED * steps.vetoed
        + UNSAFE * steps["unsafe"]
        + NO_SAFE * steps.no_safe
        + LARGE_ERROR * errors.large
    )
    # 128: the model does not know the action.
    flags = (steps["flags"] & 0xFF) | (128 * (steps["ground"] < 0))
    ends = [episode.rows.stop - 1 for episode in steps.episodes]
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
        "causeAt": accounts.at,
        "causeAction": accounts.action,
        "cause": accounts.cause,
        "amount": accounts.amount,
        "sentence": accounts.sentence,
        "sentences": np.frombuffer("\n".join(accounts.sentences).encode(), np.uint8),
    }


def episode_data(steps: RecordedSteps, scenes: DrawnScenes) -> list[dict[str, Any]]:
    """Return the episodes as JSON values."""
    data = []
    for episode in steps.episodes:
        frame, frames = scenes.frames.get(episode.number, (0, 0))
        data.append(
            {
                "number": episode.number,
                "first": episode.first,
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
