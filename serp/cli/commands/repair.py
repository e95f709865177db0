"""`serp repair`: the domain file of a run, repaired by what the run has observed."""

from __future__ import annotations

import codecs
import difflib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.cli.failures import say
from serp.cli.output import ExampledCommand, open_console
from serp.errors import SerpError

if TYPE_CHECKING:
    from rich.console import Console

    from serp.diagnosis.recorded_run import Recorded

_STYLES = {"+": "green", "-": "red", "@": "cyan"}


@click.command(
    "repair",
    cls=ExampledCommand,
    examples=[
        "serp repair runs/seven",
        "serp repair runs/seven -o cartpole-repaired.pddl",
        "serp repair runs/seven -o domains/cartpole.pddl --force",
    ],
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option("-o", "--out", type=click.Path(path_type=Path), metavar="FILE.pddl",
              help="Where the repaired file goes.  [default: it is only shown]")  # fmt: skip
@click.option("--force", is_flag=True,
              help="Replace FILE.pddl and its problem file where they exist.")  # fmt: skip
@click.pass_context
def command(ctx: click.Context, run: Path, out: Path | None, force: bool) -> None:
    """Correct the domain file of RUN, a folder of plan-and-learn, and show what changes.

    What `serp diagnose` lists is written: numbers are changed where they stand, and effects that
    the file does not mention are added, each with its evidence as a comment; everything else stays
    as it is. What is rewarded, unsafe or an end is never touched: what came of it, and what chance
    does, is told in comments. What is not explained is listed, and stands at the head of the file.
    """
    if out is not None and out.suffix.lower() != ".pddl":
        raise click.BadParameter("name a file that ends in .pddl", ctx, param_hint="--out")
    if out is not None and not force:
        _refuse_to_replace(out)

    from serp.diagnosis.analysis import findings
    from serp.diagnosis.diagnosis import make_diagnosis
    from serp.diagnosis.recorded_run import read_recorded
    from serp.diagnosis.repair.repair import repair

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
    if not repaired.repairs:
        console.print(
            f"{name}: nothing to repair was found in {steps}"
            + ("" if out is None else f", and {out} was not written")
        )
        console.print(diagnosis.verdict)
        _print_open(repaired.open)
        return
    _print_difference(
        console, recorded.domain.source.text, repaired.text, Path(name).name,
        "repaired" if out is None else str(out),
    )  # fmt: skip
    _print_open(repaired.open)
    changes = plural(len(repaired.repairs), "change")
    if out is None:
        say(f"{changes}, from {steps}; -o FILE.pddl writes the repaired file")
        return
    _write(recorded, repaired.text, out)
    say(f"{changes}, from {steps}; the repaired file is {out}")


def _print_open(sentences: Sequence[str]) -> None:
    """Say what is not explained, or not written."""
    if sentences:
        say("Not explained, and left as it is:")
    for sentence in sentences:
        say(f"  {sentence}")


def _refuse_to_replace(file: Path) -> None:
    if os.path.lexists(file):
        raise SerpError(f"{file} exists; give another name, or replace it with --force")


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


def _refuse_the_copies(recorded: Recorded, out: Path) -> None:
    """Refuse the run's own copies, which say what its lines and numbers are about."""
    if os.path.realpath(out) in {os.path.realpath(recorded.run / n) for n in recorded.files}:
        raise SerpError(f"{out} belongs to the run; give a name outside {recorded.run}")


def _write(recorded: Recorded, text: str, out: Path) -> None:
    problem = recorded.domain.problem_source
    beside = write_with_problem(out, text, None if problem is None else problem.text)
    if beside is not None:
        say(f"Its problem file is copied to {beside}")


def write_with_problem(out: Path, text: str, problem: str | None) -> Path | None:
    """Write a domain file and, where it is not there already, its problem file beside it.

    Args:
        out: The domain file.
        text: What is written to it.
        problem: Text of the problem; None where there is none.

    Returns:
        The problem file; None where none was written.

    Raises:
        SerpError: One of them cannot be written; see `write_together`.
    """
    from serp._util.files import write_together

    beside = _problem_beside(out)
    if problem is None or _holds(beside, problem):
        write_together({out: text})
        return None
    write_together({beside: problem, out: text})
    return beside


def _problem_beside(out: Path) -> Path:
    return out.with_name(f"{out.stem}-problem.pddl")


def _holds(file: Path, text: str) -> bool:
    try:
        return file.read_bytes().removeprefix(codecs.BOM_UTF8) == text.encode("utf-8")
    except OSError:
        return False


def _print_difference(console: Console, old: str, new: str, name: str, new_name: str) -> None:
    lines = difflib.unified_diff(
        old.splitlines(), new.splitlines(), name, new_name, n=2, lineterm=""
    )
    for line in lines:
        style = _STYLES.get(line[:1])
        if line.startswith(("+++", "---")):
            style = "bold"
        console.print(line, style=style, soft_wrap=True)
