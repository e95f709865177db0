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
    say what was observed of them, and of stochastic effects. The head of the file lists what is
    not explained.
    """
    if out is not None and not force:
        _refuse_to_replace(out)

    from serp.runs.diagnosis.analysis import findings
    from serp.runs.diagnosis.diagnosis import make_diagnosis, read_recorded
    from serp.runs.diagnosis.repair import repair

    recorded = read_recorded(run)
    if out is not None:
        _refuse_the_copies(recorded, out)
        if not force:
            _refuse_another_problem(recorded, out)
    if recorded.notice is not None:
        say(recorded.notice)
    diagnosis = make_diagnosis(recorded, findings(recorded.model, recorded.experience))
    repaired = repair(recorded.domain, diagnosis.worthwhile, diagnosis.unexplained)
    console = open_console()
    name = recorded.files.get("domain.pddl", "domain.pddl")
    steps = plural(len(diagnosis.sample), "step")
    if repaired.changes:
        new_name = "repaired" if out is None else str(out)
        old = recorded.domain.source.text
        _print_difference(console, old, repaired.text, Path(name).name, new_name)
    else:
        unwritten = "" if out is None else f", and {out} was not written"
        console.print(f"{name}: nothing to repair was found in {steps}{unwritten}")
        console.print(diagnosis.verdict)
    if repaired.open:
        say("\n  ".join(["Not explained, and left as it is:", *repaired.open]))
    if not repaired.changes:
        return
    changes = plural(len(repaired.changes), "change")
    if out is None:
        say(f"{changes}, from {steps}; -o FILE.pddl writes the repaired file")
        return
    _write(recorded, repaired.text, out)
    say(f"{changes}, from {steps}; the repaired file is {out}")


def _refuse_to_replace(file: Path) -> None:
    if os.path.lexists(file):
        raise SerpError(f"{file} exists; give another name, or replace it with --force")


def _refuse_the_copies(recorded: Recorded, out: Path) -> None:
    """Refuse the run's own copies, which say what its lines and numbers are about."""
    if os.path.realpath(out) in {os.path.realpath(recorded.run / n) for n in recorded.files}:
        raise SerpError(f"{out} belongs to the run; give a name outside {recorded.run}")


def _refuse_another_problem(recorded: Recorded, out: Path) -> None:
    """Refuse a name beside which a problem file stands that is not the run's own."""
    beside, problem = _problem_beside(out), recorded.domain.problem_source
    if problem is None and os.path.lexists(beside):
        raise SerpError(
            f"{beside} would be taken for the problem of {out}, and the run has none; give another "
            "name, or leave it there with --force"
        )
    if problem is not None and not _holds(beside, problem.text):
        _refuse_to_replace(beside)


def _write(recorded: Recorded, text: str, out: Path) -> None:
    """Write the domain file and, where it is not there already, its problem file beside it."""
    from serp._util.files import write_together

    beside, problem = _problem_beside(out), recorded.domain.problem_source
    if problem is None or _holds(beside, problem.text):
        write_together({out: text})
        return
    write_together({beside: problem.text, out: text})
    say(f"Its problem file is copied to {beside}")


def _problem_beside(out: Path) -> Path:
    return out.with_name(f"{out.stem}-problem.pddl")


def _holds(file: Path, text: str) -> bool:
    try:
        return file.read_bytes().removeprefix(codecs.BOM_UTF8) == text.encode("utf-8")
    except OSError:
        return False


def _print_difference(console: Console, old: str, new: str, name: str, new_name: str) -> None:
    styles = {"+": "green", "-": "red", "@": "cyan"}
    lines = difflib.unified_diff(
        old.splitlines(), new.splitlines(), name, new_name, n=2, lineterm=""
    )
    for line in lines:
        style = "bold" if line.startswith(("+++", "---")) else styles.get(line[:1])
        console.print(line, style=style, soft_wrap=True)
