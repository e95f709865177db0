"""Writes the results of a run into its folder: summary, learning curve, report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from serp._util.json_files import finite
from serp.runs import plots
from serp.runs.folder import DECISIONS, METRICS, RunFolder
from serp.runs.reading import read_metrics, read_tally
from serp.runs.report import report
from serp.runs.summary import summarize


def write_results(run: RunFolder, compile_seconds: float = 0.0) -> None:
    """Writes ``summary.json``, ``learning-curve.png``, ``learning-curve.svg`` and ``report.md``.

    Args:
        run: open for writing; its tables are flushed first.
        compile_seconds: what compilation took, beside the training.

    Raises:
        RunError: a table is malformed, or a write failed.
    """
    run.flush()
    metrics = read_metrics(run.path / METRICS)
    vetoes = read_tally(run.path / DECISIONS).vetoes_by_reason()
    summary: dict[str, Any] = finite(summarize(metrics, run.config, vetoes, compile_seconds))
    run.write_summary(summary)
    figure = plots.learning_curve(metrics, _title(summary))
    run.write("learning-curve.png", plots.render(figure, "png"))
    run.write("learning-curve.svg", plots.render(figure, "svg"))
    run.write("report.md", report(run.about, summary))


def _title(summary: Mapping[str, Any]) -> str:
    parts = [str(summary[key]) for key in ("domain",) if key in summary]
    parts += [f"{key} {summary[key]}" for key in ("preset", "seed") if key in summary]
    return ", ".join(parts) or "Learning curve"
