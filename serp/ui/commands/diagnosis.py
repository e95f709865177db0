"""Commands about the domain file of a run: `diagnose` and `repair`."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import percent, plural, readable
from serp.errors import RunError, SerpError, needs_extra
from serp.ui.options import OutputFile, again, command, json_option, run_argument
from serp.ui.output import print_difference, print_json, print_next, print_table, show
from serp.ui.root import say, working

if TYPE_CHECKING:
    from serp.model.learned.adoption import WorthAdoption
    from serp.runs.diagnosis.diagnosis import Diagnosis
    from serp.runs.diagnosis.findings import Finding
    from serp.runs.run import Run


@command(
    "serp diagnose runs/seven",
    "serp diagnose runs/seven --all --svg diagnosis.svg",
    "serp diagnose runs/seven --json > diagnosis.json",
)
@run_argument
@json_option
@click.option("--all", "everything", is_flag=True,
              help="Show all findings, and the errors of each fluent.")  # fmt: skip
@click.option("--svg", type=OutputFile(".svg"), metavar="FILE.svg",
              help="File for a chart of predicted against observed changes.")  # fmt: skip
def diagnose(run: Path, as_json: bool, everything: bool, svg: Path | None) -> None:
    """Report what is wrong or missing in the domain file of RUN.

    The fluents, rewards and ends that the file predicts are compared with the run's newest steps
    (up to 20,000). The three most costly findings are shown, each with the edit that `serp repair`
    makes. The command does not need the environment, and changes nothing.
    """
    if svg is not None:
        with needs_extra("plots", "a picture of a diagnosis"):
            from serp.runs.diagnosis.plots import picture

    from serp._util.files import write_durably
    from serp.runs.diagnosis import diagnosis as diagnosing

    with working(f"comparing {run} with its domain file"):
        diagnosis = diagnosing.diagnose(run)
    if as_json:
        print_json(diagnosing.as_dict(diagnosis))
    else:
        _print_diagnosis(diagnosis, everything=everything)
    if svg is not None:
        write_durably(svg, picture(diagnosis, "svg"))
        say(f"A chart of predicted against observed changes is in {svg}")


_FIRST = 3
"""Findings that are shown without `--all`."""


def _print_diagnosis(diagnosis: Diagnosis, *, everything: bool) -> None:
    from serp.runs.oscillation import oscillation

    recorded, sample = diagnosis.recorded, diagnosis.steps.sample
    file = next(iter(recorded.metadata["domain_files"].values()), recorded.domain.name)
    newest = f"{len(recorded.adaptation.experience):,} of {plural(recorded.env_steps, 'step')}"
    show(f"{recorded.path}: {file} compared with {newest}")
    if sample.left_out:
        reasons = ", ".join(f"{count:,} with {reason}" for reason, count in sample.left_out.items())
        skipped = plural(sum(sample.left_out.values()), "step")
        show(f"{skipped} could not be compared: {reasons}")
    if recorded.made.learned_from == "environment":
        show("Rewards are compared with those of the environment.")
    show(diagnosis.verdict)
    if (told := oscillation(recorded, recorded.recording())) is not None:
        show(f"\n{told}")
    remarks = diagnosis.remarks if everything else diagnosis.remarks[:_FIRST]
    if len(diagnosis.remarks) > 1:
        show("\nAll findings were fitted together, so apply all of their edits or none.")
    for number, remark in enumerate(remarks, 1):
        show(f"\n{number}. {remark.text}.")
        names = " and ".join(f"({name})" for name in sorted(remark.finding.symbols))
        show(f"   This explains {percent(remark.share)} of the error in {names}.")
        _print_edit(recorded, remark.finding)
    if everything:
        _print_errors(diagnosis)
    elif rest := len(diagnosis.remarks) - len(remarks):
        show(f"\n--all shows {plural(rest, 'more finding')}, and the error of each fluent")
    if remarks:
        print_next(
            (again("repair", run=recorded), "show all edits together"),
            (again("repair", "-o", "FILE.pddl", run=recorded), "write the repaired file"),
        )


def _print_edit(recorded: Run, finding: Finding) -> None:
    """Print the change of the file that `serp repair` makes for one finding."""
    from serp.runs.diagnosis.findings import Findings, RuleFinding
    from serp.runs.diagnosis.repair import repair

    if isinstance(finding, RuleFinding):
        show("   `serp repair` only writes a comment, because rewards and ends define the task.")
        return

    old = recorded.domain.source.text
    print_difference(
        old, repair(recorded.domain, Findings.of(finding)).text, context=0, indent="   "
    )


def _print_errors(diagnosis: Diagnosis) -> None:
    """Print the error of each quantity, and how well rewards and ends were predicted."""
    quantities = sorted(diagnosis.quantities, key=lambda q: -q.error)
    if quantities:
        show()
        head = ("fluent", "change in a step", "the file's error", "with findings", "mostly after")
        table = [
            (
                quantity.shown,
                readable(quantity.change) if quantity.numeric else f"{quantity.change:,.0f} times",
                percent(quantity.error),
                percent(quantity.error_left),
                quantity.action if quantity.squared else "",
            )
            for quantity in quantities
        ]
        print_table(head, table, right=range(1, 4))
    adoption = diagnosis.recorded.adaptation.adoption
    show(f"\nThe run planned with this model: {adoption}")
    with contextlib.suppress(RunError):  # a run that has not ended has no summary
        for key in ("safety", "risk"):
            if said := diagnosis.recorded.summary.get(key):
                show(f"\n{said}.")
    _print_worth(adoption.worth)


def _print_worth(worth: tuple[WorthAdoption, ...]) -> None:
    """Print how well reward and end were predicted before each step was learned from."""
    told = [each for each in worth if each.corrected]
    if not told:
        return
    head = ("in the newest steps", "by the file's rules", "corrected")
    rows = []
    for each in told:
        ends = each.name == "terminal"
        name = "end: Brier score" if ends else "reward: root mean square error"
        errors = each.written, each.in_use
        rows.append((name, *(readable(error if ends else error**0.5) for error in errors)))
    print_table(head, rows, right=[1, 2])
    rows = [
        (percent(of.chance), percent(of.ended), f"{of.steps:,}")
        for each in told
        for of in each.reliability
    ]
    if rows:
        print_table(("chance of an end", "ended", "steps"), rows, right=range(3))


@command(
    "serp repair runs/seven",
    "serp repair runs/seven -o cartpole-repaired.pddl",
    "serp repair runs/seven -o domains/cartpole.pddl --force",
)
@run_argument
@click.option("-o", "--out", type=OutputFile(".pddl"), metavar="FILE.pddl",
              help="Write the repaired file here.  [default: only show it]")  # fmt: skip
@click.option("--dry-run", is_flag=True, help="Show the changes, and write nothing.")
@click.option("--force", is_flag=True,
              help="Replace FILE.pddl and its problem file if they exist.")  # fmt: skip
def repair(run: Path, out: Path | None, dry_run: bool, force: bool) -> None:
    """Correct the domain file of RUN, and show what changes.

    The command corrects numbers and adds missing effects, each with its evidence in a comment. It
    writes random outcomes as `probabilistic`. It never changes rewards, `(unsafe)` or ends, but
    adds comments that say what was observed. All other text stays the same.
    """
    from serp.runs.diagnosis import repair as repairing
    from serp.runs.diagnosis.analysis import findings
    from serp.runs.diagnosis.diagnosis import make_diagnosis, read_recorded

    with working(f"comparing {run} with its domain file"):
        recorded = read_recorded(run)
        out = None if dry_run else out
        if out is not None:
            _refuse_to_replace(recorded, out, force)
        found = findings(recorded.model, recorded.adaptation.experience)
        diagnosis = make_diagnosis(recorded, found)
        repaired = repairing.repair(recorded.domain, diagnosis.worthwhile)
    name = recorded.metadata["domain_files"].get("domain.pddl", "domain.pddl")
    steps = plural(len(diagnosis.steps.sample), "step")
    changes = plural(len(repaired.changes), "change")
    if repaired.changes:
        new_name = "repaired" if out is None else str(out)
        print_difference(recorded.domain.source.text, repaired.text, (Path(name).name, new_name))
    else:
        unwritten = "" if out is None else f", and {out} was not written"
        show(f"{name}: nothing to repair was found in {steps}{unwritten}")
        show(diagnosis.verdict)
    if diagnosis.unexplained:
        say("\n  ".join(["Not repaired, or only partly:", *diagnosis.unexplained]))
    if repaired.changes and out is not None:
        _write(recorded, repaired.text, out)
        say(f"{changes}, from {steps}; the repaired file is {out}")
    elif repaired.changes:
        say(f"{changes}, from {steps}; -o FILE.pddl writes the repaired file")


def _refuse_to_replace(recorded: Run, out: Path, force: bool) -> None:
    """Refuse names of the run's own copies and, without `force`, of files that exist."""
    from serp.model.domain import problem_beside

    if os.path.realpath(out) in {os.path.realpath(copy) for copy in recorded.copies()}:
        raise SerpError(f"{out} belongs to the run; give a name outside {recorded.path}")
    for file, what in ((out, ""), (problem_beside(out), f" and would be {out}'s problem file")):
        if os.path.lexists(file) and not force:
            raise SerpError(f"{file} exists{what}; give another name, or overwrite it with --force")


def _write(recorded: Run, text: str, out: Path) -> None:
    """Write the domain file and, if there is one, its problem file beside it."""
    from serp._util.files import write_together
    from serp.model.domain import problem_beside

    beside, problem = problem_beside(out), recorded.domain.problem_source
    write_together({**({} if problem is None else {beside: problem.text}), out: text})
    if problem is not None:
        say(f"Problem file copied to {beside}")
