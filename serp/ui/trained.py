"""What is said of a trained agent, and of what it did."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from serp._util.text import percent, plural, readable
from serp.ui.output import print_table

if TYPE_CHECKING:
    from rich.console import Console


def unsafe_text(counts: Mapping[str, Any]) -> str:
    """Return how often a run, or an evaluation, was unsafe: by prediction, and by observation."""
    text = f"{plural(counts['unsafe_executed'], 'action')} executed that the domain file flags"
    if counts["avoidable_unsafe"]:
        text += f", {counts['avoidable_unsafe']:,} of them while another one was not flagged"
    return text + f"; {plural(counts['unsafe_observed'], 'step')} observed unsafe, predicted or not"


def print_account(
    console: Console, account: Mapping[str, Any], sight: Mapping[str, float | None]
) -> None:
    """Print what `serp.agent.agent.account_of` and `sight_of` return."""
    rows = [("trained policy", account["trained_policy"])]
    if account["evidence"] is not None:
        rows.append(("evidence", account["evidence"]["sentence"]))
    if sight["safety_alone"] is not None:
        share = {name: percent(share or 0.0) for name, share in sight.items()}
        parts = []
        if sight["saw_all"] is not None:
            parts.append(
                f"complete lookahead in {share['saw_all']} of its plans, cells in "
                f"{share['by_cells']}, budget reached in {share['cut_short']}, indifferent in "
                f"{share['indifferent']}"
            )
            if sight["mean_depth"] is not None:
                parts[0] += f"; otherwise {readable(sight['mean_depth'])} layers of states"
        if sight["safety_alone"]:
            parts.append(f"In {share['safety_alone']} of the steps only safety was checked")
        rows.append(("planner saw", ". ".join(parts)))
    rows.append(("model", account["model"]["sentence"]))
    rows += [
        ("", f"{fluent['fluent']} as written: {fluent['why']}")
        for fluent in account["model"]["fluents"]
        if not fluent["adapted"]
    ]
    print_table(console, ("", ""), rows)
