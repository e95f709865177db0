"""The results of a run: ``summary.json``, ``report.md`` and the learning curve."""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Mapping
from typing import Any

from serp._util.files import finite, json_text
from serp._util.text import code, duration, markdown_text, plural, readable, table
from serp.errors import MissingExtra, Notice, needs_extra
from serp.runs.folder import DECISIONS, METRICS, SUMMARY, RunFolder
from serp.runs.summary import FIRST, WINDOW, summarize
from serp.runs.tables import count_decisions, read_metrics


def report(metadata: Mapping[str, Any], summary: Mapping[str, Any], *, drawn: bool = True) -> str:
    """Return a short report of a run as Markdown; `drawn`: with the picture of its learning curve.

    `serp report` shows the whole run.
    """
    sections = [f"# Run: {markdown_text(title(summary))}", lead(summary)]
    if drawn:
        sections.append("![Learning curve: return per episode](learning-curve.png)")
    if "trained_policy" in summary:
        sections.append(f"The trained policy is {markdown_text(summary['trained_policy'])}.")
    if summary.get("evidence"):
        sections.append(f"The evidence: {markdown_text(summary['evidence']['sentence'])}.")
    if "model" in summary:
        sections.append(f"The model is {markdown_text(summary['model']['sentence'])}.")
    vetoes = summary["vetoes_by_reason"].items()
    if vetoes:
        rows = [(markdown_text(why), f"{count:,}") for why, count in vetoes]
        sections.append(table(("reason of a veto", "vetoes"), rows))
    if metadata["command"]:
        sections.append(code(shlex.join(map(str, metadata["command"]))))
    return "\n\n".join(sections) + "\n"


def title(summary: Mapping[str, Any]) -> str:
    """Return the title of a run: domain, preset and seed."""
    known = {"": "domain", "preset ": "preset", "seed ": "seed"}
    return ", ".join(f"{what}{summary[key]}" for what, key in known.items() if key in summary)


def lead(summary: Mapping[str, Any]) -> str:
    """Return the result of a run in a few sentences."""
    if not summary["episodes"]:
        return "No episode has ended yet."
    returns = summary["return"]
    result = f"was {readable(returns['mean'])}"
    if returns["last_20"] is not None:
        result = f"went from {readable(returns['first_10'])} (first {FIRST} episodes) to "
        result += f"{readable(returns['last_20'])} (last {WINDOW})"
    unsafe = f"Unsafe actions executed: {summary['unsafe_executed']:,}."
    unsafe += f" Steps that came out unsafe: {summary['unsafe_observed']:,}."
    return (
        f"{plural(summary['episodes'], 'episode')}, "
        f"{plural(summary['env_steps'], 'environment step')} in {duration(summary['wall_time'])}. "
        f"The mean return {result}. {unsafe}"
    )


def write_results(
    run: RunFolder, compile_seconds: float = 0.0, account: Mapping[str, Any] | None = None
) -> None:
    """Write ``summary.json``, ``report.md``, ``learning-curve.png`` and ``learning-curve.svg``.

    Without matplotlib there is no learning curve, and a `Notice` is issued. `compile_seconds` of
    compilation are not part of training; `account` is what `account_of` says of the agent.
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
            from serp.runs.learning_curve import learning_curve

        figure = learning_curve(metrics, title(summary))
        run.write("learning-curve.png", render(figure, "png"))
        run.write("learning-curve.svg", render(figure, "svg"))
    except MissingExtra as missing:
        warnings.warn(str(missing), Notice, stacklevel=2)
        drawn = False
    run.write("report.md", report(run.metadata, summary, drawn=drawn))
