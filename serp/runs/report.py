"""``report.md``: the report of a run.

It uses no template library, so that training does not depend on one.
"""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Mapping
from typing import Any, Final

from serp._util.files import finite, json_text
from serp._util.text import (
    code,
    duration,
    markdown_text,
    percent,
    plural,
    readable,
    sentence,
    table,
)
from serp.errors import MissingExtra, Notice, needs_extra
from serp.runs.folder import DECISIONS, METRICS, SUMMARY, RunFolder
from serp.runs.summary import (
    FIRST,
    WINDOW,
    summarize,
)
from serp.runs.tables import count_decisions, read_metrics
from serp.tasks.task import describe_source

_EXECUTED: Final = {
    "planner": "actions of the planner executed",
    "learner": "actions of the learner executed",
    "exploration": "actions of exploration executed",
    "fallback": "neither had an action (fallback)",
}
_SAFETY: Final = {
    "vetoes": "proposals vetoed",
    "unsafe_predicted": "proposals flagged unsafe or too risky",
    "unsafe_executed": "executed actions flagged unsafe",
    "avoidable_unsafe": "of them while another action was not flagged",
    "unsafe_observed": "steps that came out unsafe, foreseen or not",
    "no_safe_action": "no safe action was left to choose",
}
_SIGHT: Final = {
    "saw_all": "steps in which it saw everything that can be reached",
    "by_cells": "steps in which values of cells stood for what lies beyond the layers it saw",
    "cut_short": "steps in which its budget ended what it saw",
    "indifferent": "steps in which all plans were worth the same",
}


def report(metadata: Mapping[str, Any], summary: Mapping[str, Any], *, drawn: bool = True) -> str:
    """Return the report of a run as Markdown; `drawn`: with the picture of its learning curve."""
    sections = [f"# Run: {markdown_text(title(summary))}", lead(summary)]
    if drawn:
        sections.append(
            "![Learning curve: return per episode, and who decided](learning-curve.png)"
        )
    if "learned_from" in summary:
        source = describe_source(
            summary["learned_from"],
            in_file=bool(summary["file_rewards"]),
            world=metadata.get("config", {}).get("world") is not None,
        )
        sections.append(f"The learner learns from {source}.")
    safety = [
        (what, "–" if summary[name] is None else f"{summary[name]:,}")
        for name, what in _SAFETY.items()
    ]
    vetoes = [
        (markdown_text(why), f"{count:,}") for why, count in summary["vetoes_by_reason"].items()
    ]
    sections += [
        "## Result",
        _results(summary),
        *_lead_sections(summary),
        "## What the planner saw",
        table(("", "value"), _sight_rows(summary)),
        *_model_sections(summary),
        "## Safety",
        table(("", "steps"), safety),
        "## Vetoes by reason",
        table(("reason", "vetoes"), vetoes) if vetoes else "There were none.",
        "## How it was made",
    ]
    if metadata["command"]:
        sections.append(code(shlex.join(map(str, metadata["command"]))))
    sections.append(_origin(metadata))
    return "\n\n".join(sections) + "\n"


def _sight_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows on how far the planner saw: what, and how often or how far."""
    sight = summary["sight"]
    rows = [
        (what, "–" if sight[name] is None else percent(sight[name]))
        for name, what in _SIGHT.items()
    ]
    return [*rows, ("layers of states seen otherwise, on average", readable(sight["mean_depth"]))]


def _lead_sections(summary: Mapping[str, Any]) -> list[str]:
    if "trained_policy" not in summary:
        return []
    said = f"The trained policy is {summary['trained_policy']}."
    evidence = summary["evidence"]
    if evidence is not None:
        said += f" The evidence: {evidence['sentence']}."
    return ["## Who leads", said]


def _model_sections(summary: Mapping[str, Any]) -> list[str]:
    if "model" not in summary:
        return []
    model = summary["model"]
    sections = ["## The model it planned with", f"The model is {sentence(model['sentence'])}."]
    if model["parameters"]:
        rows = [
            (f"{p['line']}", markdown_text(p["text"]), readable(p["in_use"]))
            for p in model["parameters"]
        ]
        sections.append(table(("line", "in the file", "in use"), rows, left=2))
    if model["fluents"]:
        rows = [
            (markdown_text(f["fluent"]), "yes" if f["adapted"] else "no", sentence(f["why"]))
            for f in model["fluents"]
        ]
        sections.append(table(("fluent", "adapted", "why"), rows, left=3))
    return sections


def title(summary: Mapping[str, Any]) -> str:
    """Return the title of a run: domain, preset and seed."""
    known = {"": "domain", "preset ": "preset", "seed ": "seed"}
    return ", ".join(f"{what}{summary[key]}" for what, key in known.items() if key in summary)


def lead(summary: Mapping[str, Any]) -> str:
    """Return what came of a run in a few sentences."""
    if not summary["episodes"]:
        return "No episode has ended yet."
    returns = summary["return"]
    came = f"was {readable(returns['mean'])}"
    if returns["last_20"] is not None:
        came = f"went from {readable(returns['first_10'])} (first {FIRST} episodes) to "
        came += f"{readable(returns['last_20'])} (last {WINDOW})"
    unsafe = f"Unsafe actions executed: {summary['unsafe_executed']:,}."
    if summary["unsafe_observed"] is not None:
        unsafe += f" Steps that came out unsafe: {summary['unsafe_observed']:,}."
    return (
        f"{plural(summary['episodes'], 'episode')}, "
        f"{plural(summary['env_steps'], 'environment step')} in {duration(summary['wall_time'])}. "
        f"The mean return {came}. {unsafe}"
    )


def _results(summary: Mapping[str, Any]) -> str:
    rows: list[tuple[str, str]] = []
    for key, what in (("return", "return"), ("domain_return", "return by the domain file")):
        means = summary[key]
        best, at = readable(means["best_20"]), means["best_20_at_env_step"]
        rows += [
            (f"{what}, mean of all episodes", readable(means["mean"])),
            (f"{what}, mean of the first {FIRST} episodes", readable(means["first_10"])),
            (f"{what}, mean of the last {WINDOW} episodes", readable(means["last_20"])),
            (
                f"{what}, best mean of {WINDOW} episodes",
                best if at is None else f"{best} (at environment step {at:,})",
            ),
        ]
    rows += [
        ("episodes ended by the environment", f"{summary['terminations']:,}"),
        ("episodes ended by a limit", f"{summary['truncations']:,}"),
        ("environment steps per second of training", readable(summary["steps_per_second"])),
        ("compilation, once and beside the training", duration(summary["compile_seconds"])),
    ]
    for actor, what in _EXECUTED.items():
        share = summary["shares"][actor]
        rows.append((what, "–" if share is None else percent(share)))
    rows.append(("learner probability ρ at the end", readable(summary["final_rho"])))
    return table(("", "value"), rows)


def _origin(metadata: Mapping[str, Any]) -> str:
    rows = {
        "begun": metadata["created"],
        **{copy: f"copy of {name}" for copy, name in metadata["domain_files"].items()},
        **metadata["machine"],
        **metadata["versions"],
    }
    return table(
        ("", ""),
        [
            (markdown_text(what), markdown_text(value))
            for what, value in rows.items()
            if value is not None
        ],
    )


def write_results(
    run: RunFolder, compile_seconds: float = 0.0, account: Mapping[str, Any] | None = None
) -> None:
    """Write ``summary.json``, ``report.md``, ``learning-curve.png`` and ``learning-curve.svg``.

    Without matplotlib there is no learning curve, and a `Notice` is issued. `compile_seconds` of
    compilation are not part of training; `account` is what the agent says of itself, see
    `serp.agent.agent`.
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
