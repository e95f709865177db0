"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from serp._util.text import plural
from serp.errors import MissingExtra, SerpError, TaskError
from serp.ui.asked import asked_domain, asked_own_task
from serp.ui.main import DONE, MISTAKE, say
from serp.ui.options import max_ground_schemas_option, own_task_name, own_task_option
from serp.ui.output import examples, learned_from, open_console

if TYPE_CHECKING:
    from rich.console import Console

    from serp.authoring.lint.domain_pairs import DomainFiles
    from serp.authoring.lint.findings import Finding
    from serp.model.domain import Domain
    from serp.pddl.source import DomainWarning
    from serp.tasks.task import Task


_NAMED = 12  # actions, processes and events that one line names


class Summed(NamedTuple):
    """Findings, and lines that say what is in a domain without errors."""

    findings: list[Finding]
    summary: list[str]


def examined(
    pair: DomainFiles,
    own: Task | None,
    portable_seconds: float | None,
    max_ground_schemas: int | None,
) -> Summed:
    """Examine a domain, and the task that it belongs to.

    Raises:
        SerpError: There is no such domain, or the task that was asked for does not fit it.
    """
    from serp.authoring.lint.findings import Finding, examine
    from serp.authoring.lint.unified_planning import ask_unified_planning
    from serp.pddl.source import DomainError

    lines: list[str] = []

    def look(domain: Domain, task: Task | None) -> Iterator[DomainWarning]:
        lines.extend(_summary(domain))
        if task is not None:
            fits, unfit = _fit(task, asked=own is not None or pair.domain is None)
            yield from unfit
            if fits is not None:
                lines.extend([fits, learned_from(domain, task)])
        if portable_seconds is None:
            return
        answer, finding = ask_unified_planning(
            domain.source, domain.problem_source, portable_seconds
        )
        lines.append(f"unified-planning reads it: {answer}")
        if finding is not None:
            yield finding

    portable = portable_seconds is not None
    try:
        domain, task = _load(pair, own, max_ground_schemas)
    except DomainError as error:
        findings = []
        if pair.domain is not None:
            limit = max_ground_schemas
            findings = examine(pair.domain, pair.problem, max_ground_schemas=limit).findings
        return Summed(findings or [Finding.of(error)], [])
    found = examine(
        domain.source,
        domain.problem_source,
        max_ground_schemas=domain.max_ground_schemas,
        portable=portable,
        look=lambda _: look(domain, task),
    )
    return Summed(found.findings, lines)


def _load(
    pair: DomainFiles, own: Task | None, max_ground_schemas: int | None
) -> tuple[Domain, Task | None]:
    """Return a domain, and the task that it belongs to, with that domain; None for no task."""
    from serp.authoring.lint.domain_pairs import domain_not_found
    from serp.model.domain import load_domain
    from serp.pddl.source import DomainError, Source

    if pair.domain is None and pair.problem is not None:
        raise domain_not_found(Source.read(pair.problem))
    if pair.domain is None and own is None and Path(pair.name).is_dir():
        raise DomainError(
            f"{pair.name} is a folder; give the files in it, such as `*.pddl`",
            code="unreadable-file",
        )
    try:
        return asked_domain(pair.name, pair.domain, pair.problem, max_ground_schemas, own)
    except TaskError:
        if pair.domain is None or own is not None:
            raise
        # The package that offers the task fails; the file may be right all the same.
        return load_domain(pair.domain, pair.problem, max_ground_schemas=max_ground_schemas), None


def _fit(task: Task, *, asked: bool) -> tuple[str | None, list[DomainWarning]]:
    """Return a line that says that a task fits its domain, and what is to be known of that.

    A task that does not fit is an error if the user asked for it, else a warning.
    """
    from serp.authoring.lint.task_ranges import out_of_range
    from serp.pddl.source import DomainWarning

    try:
        with task.bind() as bound:
            findings = list(out_of_range(bound))
    except SerpError as error:
        if asked:
            raise
        return None, [DomainWarning(str(error), code="task-mismatch")]
    return f"task {bound.name}: environment, grounding and actions fit together", findings


def _summary(domain: Domain) -> Iterator[str]:
    from serp.model.ground import REWARD_TARGET, TERMINAL_TARGET, UNSAFE_TARGET

    model = domain.model
    ground = model.ground
    problem = domain.problem_source.name if domain.problem_source else "no problem file"
    objects = domain.problem_syntax.objects if domain.problem_syntax else domain.syntax.constants
    yield f"domain {domain.name} ({domain.source.name}, {problem})"
    counts = (
        plural(len(model.fluents), "fluent"),
        plural(len(ground.actions), "ground action"),
        plural(len(ground.processes), "process", "processes"),
        plural(len(ground.events), "event"),
        plural(sum(p.role != "goal" for p in model.parameters), "parameter"),
        plural(len(objects), "object"),
    )
    yield ", ".join(counts)

    def changing(target: int) -> list[str]:
        """Return what changes a target, shortened."""
        names = {
            f"{s.kind.value} {s.schema}": None
            for s in ground.schemas
            if any(effect.target == target for effect in s.effects)
        }
        listed = ", ".join([*names][:_NAMED])
        more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
        return [listed + more] if names else []

    rewarded = []
    if ground.goal_rewarded:
        worth = 1.0 if ground.goal_parameter is None else model.theta[ground.goal_parameter]
        rewarded = [f"the goal, worth {worth:g}"]
    if ground.metric is not None:
        rewarded.append(f"the problem's metric, {ground.metric.place.text}")
    ends = ["the problem's goal"] if ground.goal is not None else []
    ends += changing(TERMINAL_TARGET)
    yield f"unsafe: {', '.join(changing(UNSAFE_TARGET)) or 'nothing'}"
    yield f"reward: {'; '.join(rewarded or changing(REWARD_TARGET)) or 'nothing'}"
    yield f"terminal: {', '.join(ends) or 'nothing'}"


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
    from serp.authoring.lint.domain_pairs import DomainFiles, pairs

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
        from serp.authoring.lint.formats import FORMATS

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
    from serp.authoring.lint.fixing import difference, mended, write_changed
    from serp.model.domain import problem_beside
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
    from serp.authoring.lint.fixing import changes

    for _ in changes([path for pair in checks for path in pair[1:] if path is not None]):
        click.clear()
        click.echo(f"checking at {time.strftime('%H:%M:%S')}")
        once()
        click.echo("waiting for changes (Ctrl-C ends)")
    return DONE
