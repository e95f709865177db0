"""Writes the results of a run into its folder: summary, learning curve, report."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from serp._util.json_files import finite, json_text
from serp.errors import MissingExtra, Notice, needs_extra
from serp.runs.folder import DECISIONS, METRICS, SUMMARY, RunFolder
from serp.runs.reading import count_decisions, read_metrics
from serp.runs.report import report, title
from serp.runs.summary import summarize


def write_results(
    run: RunFolder, compile_seconds: float = 0.0, account: Mapping[str, Any] | None = None
) -> None:
    """Write ``summary.json``, ``report.md``, ``learning-curve.png`` and ``learning-curve.svg``.

    Without matplotlib there is no learning curve, and a `Notice` is issued. `compile_seconds` of
    compilation are not part of training; `account` is what the agent says of itself, see
    `serp.training.account`.
    """
    run.flush()
    metrics = read_metrics(run.path / METRICS)
    vetoes = count_decisions(run.path / DECISIONS).vetoes_by_reason()
    summary: dict[str, Any] = finite(
        summarize(metrics, run.config, vetoes, compile_seconds, account)
    )
    run.write(SUMMARY, json_text(summary))
    drawn = True
    try:
        with needs_extra("plots", "the learning curve"):
            from serp._util.figures import render
            from serp.runs.plots import learning_curve

        figure = learning_curve(metrics, title(summary))
        run.write("learning-curve.png", render(figure, "png"))
        run.write("learning-curve.svg", render(figure, "svg"))
    except MissingExtra as missing:
        warnings.warn(str(missing), Notice, stacklevel=2)
        drawn = False
    run.write("report.md", report(run.metadata, summary, drawn=drawn))
