"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.cli.asked import asked_domain, asked_own_task
from serp.cli.failures import DONE, MISTAKE, say
from serp.cli.options import max_ground_schemas_option, own_task_name, own_task_option
from serp.cli.output import examples, learned_from, open_console
from serp.errors import MissingExtra, SerpError, TaskError

if TYPE_CHECKING:
    from rich.console import Console

    from serp.lint.domain_pairs import DomainFiles
    from serp.model.loading import Domain
    from serp.pddl.source import DomainWarning
    from serp.tasks.task import Task

_NAMED = 12  # actions, processes and events that one line names
_WARNINGS = 100  # warnings of one domain that are printed


@click.command(
    "check",
    epilog=examples(
        "serp check domains/cartpole.pddl",
        "serp check cartpole",
        "serp check domains/*.pddl",
        "serp check domain.pddl p01.pddl --portable",
        "serp check --task my_robot.py",
    ),
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1)
@own_task_option
@click.option("--portable", is_flag=True,
              help="Name extensions of PDDL; ask unified-planning to read the files.")  # fmt: skip
@click.option("--portable-seconds", type=click.FloatRange(min=0, min_open=True), default=60.0,
              show_default=True, metavar="S", help="Most seconds to wait for it.")  # fmt: skip
@max_ground_schemas_option
def command(
    domains: tuple[str, ...],
    portable: bool,
    portable_seconds: float,
    max_ground_schemas: int | None,
) -> int:
    """Check domain and problem files: say what is wrong and where, or what is in them.

    A problem file is checked with its domain: the given file of the domain that it names, or else
    `<name>.pddl` beside `<name>-problem.pddl`, or `domain.pddl`.

    Where a file belongs to a task (an installed one, or --task), its environment is made to see
    whether grounding and actions fit the file. It is neither reset nor stepped.

    Every file is checked, even where one before it is wrong. Warnings (what may have been
    forgotten, and what other PDDL tools refuse) leave the exit status 0.
    """
    from serp.lint.domain_pairs import DomainFiles, pairs

    own = asked_own_task()
    if not domains and own is None:
        raise click.UsageError("give files, names of installed tasks, or --task")
    console = open_console()
    seconds = portable_seconds if portable else None
    warned, found = 0, Counter[str]()
    checks = pairs(domains) if domains else [DomainFiles(str(own_task_name()), None, None)]
    for position, check in enumerate(checks):
        if position:
            console.print("")
        result = "right"
        try:
            warned += _report(console, check, own, seconds, max_ground_schemas)
        except SerpError as error:
            result = "not checked" if isinstance(error, MissingExtra) else "wrong"
            console.print(f"{check.name}: {result}", style="bold red")
            say(str(error))
        found[result] += 1
    if len(checks) > 1:
        unchecked = f", {found['not checked']} not checked" if found["not checked"] else ""
        console.print(
            f"\n{plural(len(checks), 'domain')}: {found['right']} right, {found['wrong']} wrong"
            f"{unchecked}, {plural(warned, 'warning')}"
        )
    return DONE if found["right"] == len(checks) else MISTAKE


def _report(
    console: Console,
    pair: DomainFiles,
    own: Task | None,
    portable_seconds: float | None,
    max_ground_schemas: int | None,
) -> int:
    """Load a domain and print what is in it; return the number of warnings."""
    from serp.lint.portability import beyond_pddl, outside_portable_subset
    from serp.lint.rules import warnings_of
    from serp.lint.unified_planning import ask_unified_planning

    domain, task = _load(pair, own, max_ground_schemas)
    findings = warnings_of(domain)
    lines = list(_summary(domain))
    if task is not None:
        fits, unfit = _fit(task, asked=own is not None or pair.domain is None)
        findings += unfit
        if fits is not None:
            lines += [fits, learned_from(domain, task)]
    for source in filter(None, (domain.source, domain.problem_source)):
        findings += outside_portable_subset(source)
        if portable_seconds is not None:
            findings += beyond_pddl(source, domain.syntax.declarations)
    console.print(f"{pair.name}: right", style="bold green")
    for line in lines:
        console.print(f"  {line}")
    warnings = [str(finding) for finding in findings]
    if portable_seconds is None:
        console.print("  unified-planning reads it: not asked (--portable asks)")
    else:
        answer, finding = ask_unified_planning(
            domain.source, domain.problem_source, portable_seconds
        )
        console.print(f"  unified-planning reads it: {answer}")
        warnings += [] if finding is None else [str(finding)]
    for warning in warnings[:_WARNINGS]:
        console.print(f"  warning: {warning}", style="yellow")
    if len(warnings) > _WARNINGS:
        console.print(f"  ... and {plural(len(warnings) - _WARNINGS, 'more warning')}")
    return len(warnings)


def _load(
    pair: DomainFiles, own: Task | None, max_ground_schemas: int | None
) -> tuple[Domain, Task | None]:
    """Return a domain, and the task that it belongs to, with that domain; None for no task."""
    from serp.model.loading import load_domain

    if pair.domain is None and pair.problem is not None:
        raise SerpError(
            f"{pair.problem}: a problem file, and its domain file is not known; give both, as in "
            f"`serp check domain.pddl {pair.problem}`"
        )
    if pair.domain is None and own is None and Path(pair.name).is_dir():
        raise SerpError(f"{pair.name} is a folder; give the files in it, such as `*.pddl`")
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
    from serp.lint.task_ranges import out_of_range
    from serp.pddl.source import DomainWarning

    try:
        with task.bind() as bound:
            findings = list(out_of_range(bound))
    except SerpError as error:
        if asked:
            raise
        return None, [DomainWarning(str(error))]
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
