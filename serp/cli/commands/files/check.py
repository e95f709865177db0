"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.cli.asked import asked_own_task
from serp.cli.domain_summary import examined
from serp.cli.failures import DONE, MISTAKE, say
from serp.cli.options import max_ground_schemas_option, own_task_name, own_task_option
from serp.cli.output import examples, open_console
from serp.errors import MissingExtra, SerpError

if TYPE_CHECKING:
    from rich.console import Console

    from serp.lint.domain_pairs import DomainFiles
    from serp.lint.findings import Finding
    from serp.tasks.task import Task

_REMARKS = 100  # warnings and notes of one domain that are printed


@click.command(
    "check",
    epilog=examples(
        "serp check domains/cartpole.pddl",
        "serp check cartpole",
        "serp check domains/*.pddl",
        "serp check domain.pddl p01.pddl --portable",
        "serp check --task my_robot.py",
        "serp check robot.pddl --fix",
        "serp check robot.pddl --watch",
        "serp check domains/*.pddl --format sarif > findings.sarif",
    ),
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1)
@own_task_option
@click.option("--fix", is_flag=True,
              help="Correct what can only be meant one way; print the changes.")  # fmt: skip
@click.option("--watch", is_flag=True, help="Check again whenever a file changes.")
@click.option("--format", "form", type=click.Choice(["text", "json", "sarif", "github"]),
              default="text", show_default=True,
              help="How findings are printed: for people, or for other programs.")  # fmt: skip
@click.option("--json", "form", flag_value="json", help="The same as --format json.")
@click.option("--portable", is_flag=True,
              help="Name extensions of PDDL; ask unified-planning to read the files.")  # fmt: skip
@click.option("--portable-seconds", type=click.FloatRange(min=0, min_open=True), default=60.0,
              show_default=True, metavar="S", help="Most seconds to wait for it.")  # fmt: skip
@max_ground_schemas_option
def command(
    domains: tuple[str, ...],
    fix: bool,
    watch: bool,
    form: str,
    portable: bool,
    portable_seconds: float,
    max_ground_schemas: int | None,
) -> int:
    """Check domain and problem files: say all that is wrong and where, and what is in them.

    A problem file is checked with its domain: the given file of the domain that it names, or else
    `<name>.pddl` beside `<name>-problem.pddl`, or `domain.pddl`.

    Where a file belongs to a task (an installed one, or --task), its environment is made to see
    whether grounding and actions fit the file. It is neither reset nor stepped.

    Every file is checked, even where one before it is wrong. Warnings (what may have been
    forgotten) and notes (such as what other PDDL tools refuse) leave the exit status 0. The
    comment `; serp: ignore[code]` silences one.
    """
    from serp.lint.domain_pairs import DomainFiles, pairs

    own = asked_own_task()
    if not domains and own is None:
        raise click.UsageError("give files, names of installed tasks, or --task")
    checks = pairs(domains) if domains else [DomainFiles(str(own_task_name()), None, None)]
    if watch and form != "text":
        raise click.UsageError("--watch prints for people; leave --format out")
    if (watch or fix) and not any(
        Path(name).suffix == ".pddl" or Path(name).is_file() for name in domains
    ):
        raise click.UsageError("--watch and --fix need files that are given by their paths")
    seconds = portable_seconds if portable else None
    if fix:
        _fix(checks)

    def once() -> int:
        return _check_all(_DomainCheck(own, seconds, max_ground_schemas), checks, form)

    return _watch(once, checks) if watch else once()


@dataclass
class _DomainCheck:
    """How files are checked, and what came of it."""

    own: Task | None
    portable_seconds: float | None
    max_ground_schemas: int | None
    findings: list[Finding] = field(default_factory=list)

    def run(self, pair: DomainFiles, console: Console | None) -> str:
        """Check a domain; return `right`, `wrong` or `not checked`."""
        try:
            found = examined(pair, self.own, self.portable_seconds, self.max_ground_schemas)
        except SerpError as error:
            result = "not checked" if isinstance(error, MissingExtra) else "wrong"
            if console is not None:
                console.print(f"{pair.name}: {result}", style="bold red")
            say(str(error))
            return result
        self.findings += found.findings
        errors = [f.rendered for f in found.findings if f.severity == "error"]
        remarks = [f for f in found.findings if f.severity != "error"]
        if console is None:
            return "wrong" if errors else "right"
        if errors:
            console.print(f"{pair.name}: wrong", style="bold red")
            for text in errors:
                say(text)
        else:
            console.print(f"{pair.name}: right", style="bold green")
        for line in found.summary:
            console.print(f"  {line}")
        for finding in remarks[:_REMARKS]:
            style = "yellow" if finding.severity == "warning" else "dim"
            console.print(f"  {finding.severity}: {finding.rendered}", style=style)
        if len(remarks) > _REMARKS:
            console.print(f"  ... and {len(remarks) - _REMARKS} more")
        fixable = sum(f.fix is not None and f.fix.sure for f in found.findings)
        if fixable:
            console.print(f"  {plural(fixable, 'finding')} can be corrected by --fix")
        return "wrong" if errors else "right"


def _check_all(check: _DomainCheck, checks: list[DomainFiles], form: str) -> int:
    console = open_console()
    results = []
    for position, pair in enumerate(checks):
        if position and form == "text":
            console.print("")
        results.append(check.run(pair, console if form == "text" else None))
    if form != "text":
        from serp.lint.formats import FORMATS

        click.echo(FORMATS[form](check.findings))
    elif len(checks) > 1:
        unchecked = results.count("not checked")
        warned = sum(finding.severity == "warning" for finding in check.findings)
        console.print(
            f"\n{plural(len(checks), 'domain')}: {results.count('right')} right, "
            f"{results.count('wrong')} wrong{f', {unchecked} not checked' if unchecked else ''}, "
            f"{plural(warned, 'warning')}"
        )
    return DONE if results.count("right") == len(checks) else MISTAKE


def _fix(checks: list[DomainFiles]) -> None:
    """Mend the files, and print what was changed on standard error."""
    from serp.lint.fixing import difference, mended, write_changed
    from serp.model.loading import problem_beside
    from serp.pddl.source import Source

    for pair in checks:
        if pair.domain is None or not Path(pair.name).is_file():  # what is installed stays
            continue
        beside = problem_beside(pair.domain)
        problem = pair.problem or (beside if beside.is_file() else None)
        try:
            before = Source.read(pair.domain), Source.read(problem) if problem else None
        except SerpError:  # which the check tells
            continue
        changed = {}
        for old, new in zip(before, mended(*before), strict=True):
            if old is not None and new is not None and old.text != new.text:
                click.echo(difference(old, new), err=True, nl=False)
                changed[Path(old.name)] = new.text
        write_changed(changed)


def _watch(once: Callable[[], int], checks: list[DomainFiles]) -> int:
    """Check whenever a file changes, until Ctrl-C."""
    from serp.lint.watching import changes

    for _ in changes([path for pair in checks for path in pair[1:] if path is not None]):
        click.clear()
        click.echo(f"checking at {time.strftime('%H:%M:%S')}")
        once()
        click.echo("waiting for changes (Ctrl-C ends)")
    return DONE
