"""Training for a command: the run, how it ends, and what is said of it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from serp._util.text import percent, plural, readable
from serp.ui.options import own_task_name
from serp.ui.output import open_console, print_next, print_result, print_table
from serp.ui.root import say, stopped_by

if TYPE_CHECKING:
    from rich.console import Console

    from serp.runs.run import Run
    from serp.tasks.task import Task


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
    if sight["saw_all"] is not None:
        shares = [percent(share or 0.0) for what, share in sight.items() if what != "mean_depth"]
        text = (
            "complete lookahead in {} of the steps, cells in {}, budget reached in {}, "
            "indifferent in {}".format(*shares)
        )
        if sight["mean_depth"] is not None:
            text += f"; otherwise {readable(sight['mean_depth'])} layers of states"
        rows.append(("planner saw", text))
    rows.append(("model", account["model"]["sentence"]))
    rows += [
        ("", f"{fluent['fluent']} as written: {fluent['why']}")
        for fluent in account["model"]["fluents"]
        if not fluent["adapted"]
    ]
    print_table(console, ("", ""), rows)


def train(task: Task | str, *, quiet: bool, **options: Any) -> int | None:
    """Train on a task as `serp.plan_and_learn` does, and say what came of it.

    Returns:
        The exit status of a training that was stopped; None for one that ended.
    """
    from serp.errors import Interrupted
    from serp.runs.train import plan_and_learn

    try:
        run = plan_and_learn(task, quiet=quiet, **options)
    except BaseException as error:
        notes = getattr(error, "__notes__", [])  # how the run goes on
        if notes and (own := _own_task()):
            error.add_note(f"and add{own} to the command, for this task is not installed")
        if not isinstance(error, Interrupted) and not (
            isinstance(error, KeyboardInterrupt) and notes
        ):
            raise
        message = str(error) if isinstance(error, Interrupted) else "Stopped at once."
        say("\n".join([message, *notes]))
        return stopped_by(error)
    if quiet:
        print_result(run.path)
    else:
        _print_results(run)
    return None


def _own_task() -> str:
    """Return `--task` as it was given, for a command that is to be typed next."""
    name = own_task_name()
    return f" --task {shlex.quote(name)}" if name is not None else ""


def _print_results(run: Run) -> None:
    summary: dict[str, Any] = run.summary
    episodes, returns = plural(summary["episodes"], "episode"), summary["return"]
    mean = f"{readable(returns['mean'])} on average"
    if returns["last_20"] is not None:
        mean += f", {readable(returns['first_10'])} in the first 10 episodes, "
        mean += f"{readable(returns['last_20'])} in the last 20"
    quoted = shlex.quote(str(run.path))
    console = open_console()
    console.print("")
    print_table(
        console,
        ("", ""),
        [
            ("run", str(run.path)),
            ("length", f"{episodes}, {plural(summary['env_steps'], 'env step')}"),
            ("return", mean),
            ("terminated", f"{plural(summary['terminations'], 'episode')} ended by the environment "
                           "(a fall, a crash, the goal)"),
            ("vetoes", f"{plural(summary['vetoes'], 'proposal')} refused"),
            ("unsafe", unsafe_text(summary)),
        ],
    )  # fmt: skip
    console.print("")
    print_account(console, summary, summary["sight"])
    print_next(
        console,
        (f"serp evaluate {quoted}{_own_task()}", "how good it is now, without exploration"),
        (f"serp plan {quoted}{_own_task()}", "what its planner sees, and why"),
        (f"serp why {quoted}", "what happened in a step, and the lines behind it"),
        (f"serp report {quoted}{_own_task()}", "the whole run as one page for the browser"),
    )
