"""Commands about a trained run: `why`, `report`, `evaluate`, `watch` and `export`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import percent, plural, readable
from serp.errors import needs_extra
from serp.runs import Policy
from serp.ui.options import (
    OutputFile,
    command,
    json_option,
    open_run,
    policy_option,
    run_argument,
    seed_option,
)
from serp.ui.output import print_json, print_table, show
from serp.ui.root import say, working

if TYPE_CHECKING:
    from serp.runs.run import Run
    from serp.runs.step_account import StepAccount


@command(
    "serp why runs/seven",
    "serp why runs/seven --step 1204",
    "serp why runs/seven --evaluation serp-seed0 --episode 3 --step 8 --json",
)
@run_argument
@click.option("--step", type=click.IntRange(min=0), metavar="N",
              help="Number of the step, as in decisions.csv, or within --episode, from 0.  "
                   "[default: the most informative step]")  # fmt: skip
@click.option("--episode", type=click.IntRange(min=1), metavar="E", help="The episode, from 1.")
@click.option("--evaluation", metavar="NAME",
              help="Explain a step of this evaluation (such as serp-seed0), not of the training.",
              )  # fmt: skip
@json_option
def why(
    run: Path, step: int | None, episode: int | None, evaluation: str | None, as_json: bool
) -> None:
    """Explain a step of RUN, a folder written by plan-and-learn.

    The command shows who acted and why, and the state. It shows the value, risk and reward of every
    action, with the lines of the domain file behind them. It compares what was predicted and
    observed, and shows which change in the state would have led to another action.

    If --step is not given, the command explains the last refused proposal that was applicable, else
    the last unsafe step, else the last refused proposal, else the last step.
    """
    from serp.runs.oscillation import oscillation
    from serp.runs.run import Run
    from serp.runs.step_account import account_of_step, most_telling

    if episode is not None and step is None:
        raise click.UsageError("--episode needs --step")
    read, because = Run(run), ""
    with working(f"planning a step of {run} again"):
        recording = read.recording(evaluation)
        if step is None:
            step, because = most_telling(recording)
        elif episode is not None:
            step = recording.find(episode, step)
        account = account_of_step(read, recording, step)
    if as_json:
        about = {"run": str(run), "evaluation": evaluation, "domain": read.domain.name}
        print_json({**about, "because": because, **account.as_dict()})
    else:
        _print_step(read, account, because)
        if (told := oscillation(read, recording)) is not None:
            show(f"\n{told}")


def _print_step(run: Run, account: StepAccount, because: str) -> None:
    """Print an account in sentences and tables."""
    from serp.runs.step_account import heading, what_came, what_would_differ, who_acted
    from serp.ui.account import print_explanation

    because = f": {because}" if because else ""
    show(f"{run.domain.name}, {heading(account.step)}{because}", style="bold")
    file = run.domain.source.name
    show(f"Steps are numbered from 0, episodes from 1. Lines refer to {file}.", style="dim")
    for line in [*who_acted(account), ""]:
        show(line)
    refused = account.proposed if account.step.decision.vetoed else ""
    print_explanation(account.account, [], refused)
    if account.ahead_by:
        show(f"The predictions of later steps were computed again, with {account.ahead_by}.")
    else:
        show("Later steps are not shown, because the model of that time has changed since.")
    differences = what_would_differ(account)
    for line in ["", *what_came(account), *([""] if differences else []), *differences]:
        show(line)


@command(
    "serp report runs/seven",
    "serp report runs/seven -o seven.html --pictures 0",
    "serp report runs/seven --evaluation serp-seed0 -o evaluation.html",
    "serp report runs/seven runs/eight",
)
@run_argument
@click.argument("others", type=click.Path(path_type=Path), nargs=-1, metavar="[RUN2]...")
@click.option("-o", "--out", type=OutputFile(".html"), metavar="FILE.html",
              help="The file to write.  [default: report.html in RUN]")  # fmt: skip
@click.option("--evaluation", metavar="NAME",
              help="Show the steps of this recorded evaluation.  [default: the training]",
              )  # fmt: skip
@click.option("--steps", type=click.IntRange(min=1), default=30_000, show_default=True, metavar="N",
              help="Largest number of steps shown.")  # fmt: skip
@click.option("--pictures", type=click.IntRange(min=0), default=1_000, show_default=True,
              metavar="N", help="Largest number of pictures (6 MB at most).")  # fmt: skip
def report(run: Path, others: tuple[Path, ...], out: Path | None, **options: Any) -> None:
    """Write RUN, a folder written by plan-and-learn, as one HTML file.

    A page without pictures is written after a few seconds, and later replaced by the whole page.
    The mean returns of further runs are drawn in the chart of RUN.

    The page shows curves, refusals and every recorded step. For a step it shows scene, state,
    actions, and the lines of the file behind the executed and the refused action.
    """
    from serp.runs.run import Run
    from serp.ui.report.report import write_report

    path = out or run / "report.html"
    first = f"{path}: a preliminary page is ready; pictures follow if the task has any"
    further = [Run(each) for each in others]
    write_report(open_run(run), path, others=further, on_first=lambda: say(first), **options)
    _print_size(path)


def _print_size(path: Path) -> None:
    show(f"{path}: {path.stat().st_size / 1e6:.2f} MB")


@command(
    "serp evaluate runs/seven",
    "serp evaluate runs/seven --policy planner --episodes 500",
    "serp evaluate runs/seven --policy learner --json > learner.json",
)
@run_argument
@policy_option
@click.option("--episodes", type=click.IntRange(min=1), default=100, show_default=True, metavar="N",
              help="Episodes to measure.")  # fmt: skip
@seed_option("Seed of the environment.")
@json_option
def evaluate(run: Path, policy: Policy, episodes: int, seed: int, as_json: bool) -> None:
    """Measure a policy of RUN, a folder written by plan-and-learn.

    The return is the sum of the environment's rewards. The interval contains the mean of all
    episodes with 95 % confidence (Student's t). The spread says how much single episodes differ.

    The steps are recorded in RUN; `serp why RUN --evaluation POLICY-seedN` explains them.
    """
    from serp.agent.agent import account_of

    with working(f"evaluating {run}"):
        loaded = open_run(run)
        result = loaded.evaluate(policy, episodes=episodes, seed=seed, record=True).as_dict()
    if as_json:
        print_json({"run": str(run), "seed": seed, **result, **account_of(loaded.agent)})
        return
    show(f"{run}, policy {policy}, {plural(episodes, 'episode')}, seed {seed}")
    show(f"Measured policy: {result['meaning']}.")
    steps = sum(result["lengths"])
    unsafe = f"The file flagged {plural(result['unsafe_executed'], 'executed action')}"
    if result["avoidable_unsafe"]:
        unsafe += f", {result['avoidable_unsafe']:,} of them while another action was not flagged"
    unsafe += f". {result['unsafe_observed']:,} of {steps:,} steps were observed unsafe"
    interval = ""
    if result["confidence_interval"] is not None:
        low, high = map(readable, result["confidence_interval"])
        interval = f", 95 % interval {low} to {high}"
    rows = [
        ("mean return", f"{readable(result['mean'])}{interval}"),
        ("spread", f"standard deviation {readable(result['std'])}, lowest {readable(result['min'])}"
                   f", median {readable(result['median'])}, highest {readable(result['max'])}"),
        ("terminated", f"{result['terminated']} of {episodes} episodes"),
        ("unsafe", unsafe),
        ("vetoes", f"{plural(result['vetoes'], 'proposal')} refused"),
    ]  # fmt: skip
    print_table(("", ""), rows)
    if result["warning"] is not None:
        show(result["warning"])
    show()
    print_account(account_of(loaded.agent), result["sight"])


def print_account(account: Mapping[str, Any], sight: Mapping[str, float | None]) -> None:
    """Print what `serp.agent.agent.account_of` and `sight_of` return."""
    rows = [("trained policy", account["trained_policy"])]
    if account["evidence"] is not None:
        told = "from the training (newer episodes have more weight): "
        rows.append(("evidence", told + account["evidence"]["sentence"]))
    if sight["safety_alone"] is not None:
        share = {name: percent(share or 0.0) for name, share in sight.items()}
        parts = []
        if sight["saw_all"] is not None:
            parts.append(
                f"complete in {share['saw_all']} of the plans, extended by estimates in "
                f"{share['by_cells']}, stopped by a budget in {share['cut_short']}. All actions "
                f"had the same value in {share['indifferent']} of the plans"
            )
            if sight["mean_depth"] is not None:
                parts += [f"Incomplete plans saw {readable(sight['mean_depth'])} steps on average"]
        if sight["safety_alone"]:
            parts.append(f"In {share['safety_alone']} of the steps, only safety was checked")
        rows.append(("lookahead", ". ".join(parts)))
    rows.append(("safety", account["safety"]))
    if account["risk"]:
        rows.append(("risk", account["risk"]))
    rows.append(("model", account["model"]["sentence"]))
    rows += [
        ("", f"{fluent['fluent']} not corrected: {fluent['why']}")
        for fluent in account["model"]["fluents"]
        if not fluent["adapted"]
    ]
    print_table(("", ""), rows)


@command("serp watch runs/seven", "serp watch runs/seven --episodes 1 --seed 3 --out seven.mp4")
@run_argument
@policy_option
@click.option("--episodes", type=click.IntRange(min=1), default=3, show_default=True, metavar="N",
              help="Episodes to show.")  # fmt: skip
@seed_option("Seed of the environment; `serp evaluate` plays the same episodes with the same seed.")
@click.option("-o", "--out", type=OutputFile(".mp4"), metavar="FILE.mp4",
              help="The film to write.  [default: film.mp4 in RUN, which is opened]")  # fmt: skip
def watch(run: Path, policy: Policy, episodes: int, seed: int, out: Path | None) -> None:
    """Film a policy of RUN, a folder written by plan-and-learn.

    Text below the picture says who acts and which action is executed. Refused actions are red, with
    the reason in the words of the domain file. No screen is needed. On a terminal, a film without
    --out is opened in the default player. The steps are recorded in RUN, so `serp why` explains
    them.
    """
    with needs_extra("watch", "watching a policy"):
        from serp.ui.pictures.film import write_film

    path = out or run / "film.mp4"
    write_film(open_run(run), path, policy, episodes, seed)
    _print_size(path)
    if out is None and sys.stdout.isatty():
        click.launch(str(path))


@command("serp export runs/seven -o policy", "serp export runs/seven -o robot/policy")
@run_argument
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, metavar="FOLDER",
              help="The new folder.")  # fmt: skip
def export(run: Path, out: Path) -> None:
    """Export the policy of RUN, a folder written by plan-and-learn, to FOLDER.

    FOLDER contains the domain file and what the agent has learned. With it, a robot that has serp
    makes decisions without the environment of the task.
    """
    from serp.runs.policy import export_policy

    export_policy(open_run(run), out)
    usage = f"serp.Policy({str(out)!r}, ground=ground).decide(observation)"
    say(f"{out} holds the policy. The robot calls {usage}")
