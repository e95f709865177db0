"""The results of a run: ``summary.json`` and the learning curve."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from serp._util.files import finite, json_text, write_durably
from serp._util.text import duration, plural, readable
from serp.errors import MissingExtra, Notice, needs_extra
from serp.runs.folder import METRICS, SUMMARY
from serp.runs.run import Run
from serp.runs.summary import FIRST, WINDOW, summarize
from serp.runs.tables import read_metrics


def title(summary: Mapping[str, Any]) -> str:
    """Return the title of a run: domain, preset and seed."""
    known = {"": "domain", "preset ": "preset", "seed ": "seed"}
    return ", ".join(f"{what}{summary[key]}" for what, key in known.items() if key in summary)


def return_of(summary: Mapping[str, Any]) -> str:
    """Return the mean return of the episodes of a run, with its change where there are enough."""
    returns = summary["return"]
    if returns["last_20"] is None:
        return readable(returns["mean"])
    first, last = readable(returns["first_10"]), readable(returns["last_20"])
    return f"from {first} (first {FIRST} episodes) to {last} (last {WINDOW})"


def lead(summary: Mapping[str, Any]) -> str:
    """Return the result of a run in a few sentences."""
    if not summary["episodes"]:
        return "No episode has ended yet."
    result = "was" if summary["return"]["last_20"] is None else "went"
    return (
        f"{plural(summary['episodes'], 'episode')}, "
        f"{plural(summary['env_steps'], 'environment step')} in {duration(summary['wall_time'])}. "
        f"The mean return {result} {return_of(summary)}. "
        f"Unsafe actions executed: {summary['unsafe_executed']:,}. "
        f"Steps observed unsafe: {summary['unsafe_observed']:,}."
    )


def write_results(
    run: Run, vetoes_by_reason: Mapping[str, int], account: Mapping[str, Any] | None = None
) -> None:
    """Write ``summary.json`` (see `summarize`) and ``learning-curve.png`` and ``.svg``.

    Without matplotlib there is no learning curve, and a `Notice` is issued.
    """
    metrics = read_metrics(run.path / METRICS)
    summary: dict[str, Any] = finite(summarize(metrics, run.config, vetoes_by_reason, account))
    write_durably(run.path / SUMMARY, json_text(summary))
    try:
        with needs_extra("plots", "the learning curve"):
            from serp._util.figures import render
            from serp.runs.learning_curve import learning_curve

        figure = learning_curve(metrics, title(summary))
        for kind in ("png", "svg"):
            write_durably(run.path / f"learning-curve.{kind}", render(figure, kind))
    except MissingExtra as missing:
        warnings.warn(str(missing), Notice, stacklevel=2)
