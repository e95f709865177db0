"""`serp repair`: the domain file of a run, repaired by what the run has observed."""

from __future__ import annotations

import codecs
import difflib
import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.errors import SerpError
from serp.ui.options import OutputFile, own_task_option
from serp.ui.output import examples, open_console
from serp.ui.root import say

if TYPE_CHECKING:
    from rich.console import Console

    from serp.runs.diagnosis.diagnosis import Recorded


@click.command(
    "repair",
    epilog=examples(
        "serp repair runs/seven",
        "serp repair runs/seven -o cartpole-repaired.pddl",
        "serp repair runs/seven -o domains/cartpole.pddl --force",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@own_task_option
@click.option("-o", "--out", type=OutputFile(".pddl"), metavar="FILE.pddl",
              help="Where the repaired file goes.  [default: it is only shown]")  # fmt: skip
@click.option("--force", is_flag=True,
              help="Replace FILE.pddl and its problem file where they exist.")  # fmt: skip
def command(run: Path, out: Path | None, force: bool) -> None:
    """Correct the domain file of RUN, a folder of plan-and-learn, and show what changes.

    Numbers are changed where they stand, and missing effects are added, each with its evidence as
    a comment; everything else stays as it is. Rewards, unsafe and ends are never changed: comments
    say what was observed of them, and of stochastic effects.
    """
    from serp.runs.diagnosis.analysis import findings
    from serp.runs.diagnosis.diagnosis import make_diagnosis, read_recorded
    from serp.runs.diagnosis.repair import repair

    recorded = read_recorded(run)
    if out is not None:
        _refuse_to_replace(recorded, out, force)
    diagnosis = make_diagnosis(recorded, findings(recorded.model, recorded.experience))
    repaired = repair(recorded.domain, diagnosis.worthwhile)
    console = open_console()
    name = recorded.files.get("domain.pddl", "domain.pddl")
    steps, changes = plural(len(diagnosis.sample), "step"), plural(len(repaired.changes), "change")
    if repaired.changes:
        new_name = "repaired" if out is None else str(out)
        old = recorded.domain.source.text
        _print_difference(console, old, repaired.text, Path(name).name, new_name)
    else:
        unwritten = "" if out is None else f", and {out} was not written"
        console.print(f"{name}: nothing to repair was found in {steps}{unwritten}")
        console.print(diagnosis.verdict)
    if unrepaired := [*diagnosis.unexplained, *repaired.in_problem]:
        say("\n  ".join(["Not explained, and left as it is:", *unrepaired]))
    if repaired.changes and out is not None:
        _write(recorded, repaired.text, out)
        say(f"{changes}, from {steps}; the repaired file is {out}")
    elif repaired.changes:
        say(f"{changes}, from {steps}; -o FILE.pddl writes the repaired file")


def _refuse_to_replace(recorded: Recorded, out: Path, force: bool) -> None:
    """Refuse names of the run's own copies and, without `force`, of files that exist."""
    from serp.model.domain import problem_beside

    if os.path.realpath(out) in {os.path.realpath(recorded.run / n) for n in recorded.files}:
        raise SerpError(f"{out} belongs to the run; give a name outside {recorded.run}")
    if force:
        return
    if os.path.lexists(out):
        raise SerpError(f"{out} exists; give another name, or replace it with --force")
    if os.path.lexists(beside := problem_beside(out)) and not _holds_problem(beside, recorded):
        raise SerpError(
            f"{beside} exists, and would be taken for the problem of {out}; give another name, or "
            "go on with --force"
        )


def _write(recorded: Recorded, text: str, out: Path) -> None:
    """Write the domain file and, where it is not there already, its problem file beside it."""
    from serp._util.files import write_together
    from serp.model.domain import problem_beside

    beside, problem = problem_beside(out), recorded.domain.problem_source
    if problem is None or _holds_problem(beside, recorded):
        write_together({out: text})
        return
    write_together({beside: problem.text, out: text})
    say(f"Its problem file is copied to {beside}")


def _holds_problem(file: Path, recorded: Recorded) -> bool:
    problem = recorded.domain.problem_source
    if problem is None or not file.is_file():
        return False
    return file.read_bytes().removeprefix(codecs.BOM_UTF8) == problem.text.encode("utf-8")


def _print_difference(console: Console, old: str, new: str, name: str, new_name: str) -> None:
    styles = {"+": "green", "-": "red", "@": "cyan"}
    lines = difflib.unified_diff(
        old.splitlines(), new.splitlines(), name, new_name, n=2, lineterm=""
    )
    for line in lines:
        style = "bold" if line.startswith(("+++", "---")) else styles.get(line[:1])
        console.print(line, style=style, soft_wrap=True)
