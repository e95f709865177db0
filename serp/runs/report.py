"""``report.md``: the report of a run.

It uses no template library, so that training does not depend on one.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

from serp._util.markdown import code, plain, table
from serp._util.number_format import duration, percent
from serp.runs.summary import spans
from serp.tasks.reward import describe_source

_EXECUTED: Final = {
    "planner": "actions of the planner executed",
    "learner": "actions of the learner executed",
    "exploration": "actions of exploration executed",
    "fallback": "neither had an action (fallback)",
}


def report(metadata: Mapping[str, Any], summary: Mapping[str, Any], *, drawn: bool = True) -> str:
    """Return the report of a run as plain Markdown.

    Args:
        metadata: ``config.json``: the keys that `serp.runs.config.config_text` writes.
        summary: What `serp.runs.summary.summarize` returns.
        drawn: Whether there is a picture of the learning curve.

    Returns:
        Markdown that ends with a line break.
    """
    sections = [
        f"# Run: {plain(_title(metadata, summary))}",
        _lead(summary),
        *(["![Learning curve: return per episode, and who decided](learning-curve.png)"] * drawn),
        *_learned_from(summary),
        "## Result\n\n" + _results(summary),
        "## Safety\n\n" + _safety(summary),
        "## Vetoes by reason\n\n" + _vetoes(summary["vetoes_by_reason"]),
        "## How it was made\n\n" + _origin(metadata),
    ]
    return "\n\n".join(sections) + "\n"


def _title(metadata: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    domain = summary.get("domain") or next(iter(metadata["domain_files"].values()), "unnamed")
    parts = [str(domain)]
    if summary.get("preset") is not None:
        parts.append(f"preset {summary['preset']}")
    if metadata.get("seed") is not None:
        parts.append(f"seed {metadata['seed']}")
    return ", ".join(parts)


def _lead(summary: Mapping[str, Any]) -> str:
    if not summary["episodes"]:
        return "No episode has ended yet."
    returns = summary["return"]
    first, last = spans(summary["episodes"])
    return (
        f"{summary['episodes']:,} episodes, {summary['env_steps']:,} environment steps in "
        f"{duration(summary['wall_time'])}. The mean return went from "
        f"{_number(returns['first_10'])} (first {first} episodes) to {_number(returns['last_20'])} "
        f"(last {last}). Unsafe actions executed: {summary['unsafe_executed']:,}."
    )


def _learned_from(summary: Mapping[str, Any]) -> Iterable[str]:
    if "learned_from" in summary:
        source = describe_source(summary["learned_from"], in_file=bool(summary["file_rewards"]))
        yield f"The learner learns from {source}."


def _results(summary: Mapping[str, Any]) -> str:
    shares = summary["shares"]
    rows: list[tuple[str, str]] = []
    first, last = spans(summary["episodes"])
    for key, what in (("return", "return"), ("domain_return", "return by the domain file")):
        means = summary[key]
        best_at = means["best_20_at_env_step"]
        best = _number(means["best_20"]) + (
            f" (at environment step {best_at:,})" if best_at is not None else ""
        )
        rows += [
            (f"{what}, mean of the first {first} episodes", _number(means["first_10"])),
            (f"{what}, mean of the last {last} episodes", _number(means["last_20"])),
            (f"{what}, best mean of {last} episodes", best),
        ]
    rows += [
        ("episodes ended by the environment", f"{summary['terminations']:,}"),
        ("episodes ended by a limit", f"{summary['truncations']:,}"),
        ("environment steps per second of training", _number(summary["steps_per_second"])),
        ("compilation, once and beside the training", duration(summary["compile_seconds"])),
        *(
            (what, "–" if shares[actor] is None else percent(shares[actor]))
            for actor, what in _EXECUTED.items()
        ),
        ("learner probability ρ at the end", _number(summary["final_rho"])),
    ]
    return table(("", "value"), rows)


def _safety(summary: Mapping[str, Any]) -> str:
    return table(
        ("", "steps"),
        [
            ("proposals vetoed", f"{summary['vetoes']:,}"),
            ("proposals flagged unsafe or too risky", f"{summary['unsafe_predicted']:,}"),
            ("executed actions flagged unsafe", f"{summary['unsafe_executed']:,}"),
            ("no safe action was left to choose", f"{summary['no_safe_action']:,}"),
        ],
    )


def _vetoes(vetoes: Mapping[str, int]) -> str:
    if not vetoes:
        return "There were none."
    return table(
        ("reason", "vetoes"), [(plain(why), f"{count:,}") for why, count in vetoes.items()]
    )


def _origin(metadata: Mapping[str, Any]) -> str:
    rows = [
        ("begun", plain(str(metadata["created"]))),
        *(
            (plain(copy), plain(f"copy of {name}"))
            for copy, name in metadata["domain_files"].items()
        ),
        *((plain(name), plain(value)) for name, value in metadata["machine"].items()),
        *(
            (plain(name), plain(version))
            for name, version in metadata["versions"].items()
            if version is not None
        ),
    ]
    origin = table(("", ""), rows)
    command: Sequence[str] = metadata["command"]
    if not command:
        return origin
    return f"{code(shlex.join(map(str, command)))}\n\n{origin}"


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    if isinstance(value, int) or abs(value) >= 1000:
        return f"{value:,.0f}"
    return f"{value:.4g}"
