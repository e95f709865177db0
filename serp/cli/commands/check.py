"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.cli.asked import asked_domain, asked_own_task
from serp.cli.failures import DONE, MISTAKE, say
from serp.cli.options import max_ground_schemas_option, own_task_name, own_task_option
from serp.cli.output import ExampledCommand, open_console
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
    cls=ExampledCommand,
    examples=[
        "serp check domains/cartpole.pddl",
        "serp check cartpole",
        "serp check domains/*.pddl",
        "serp check domain.pddl p01.pddl --portable",
        "serp check --task my_robot.py",
    ],
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1)
@own_task_option
@click.option("--portable", is_flag=True,
              help="Ask unified-planning as well whether it reads the files.")  # fmt: skip
@click.option("--portable-seconds", type=click.FloatRange(min=0, min_open=True), default=60.0,
              show_default=True, metavar="S", help="Most seconds to wait for it.")  # fmt: skip
@max_ground_schemas_option
@click.pass_context
def command(
    ctx: click.Context,
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
        raise click.UsageError("give files, names of installed tasks, or --task", ctx)
    console = open_console()
    wrong = warned = 0
    checks = pairs(domains) if domains else [DomainFiles(str(own_task_name()), None, None)]
    for position, check in enumerate(checks):
        if position:
            console.print("")
        try:
            warned += _report(
                console, check, own, portable_seconds if portable else None, max_ground_schemas
            )
        except SerpError as error:
            wrong += 1
            found = "not checked" if isinstance(error, MissingExtra) else "wrong"
            console.print(f"{check.name}: {found}", style="bold red")
            say(str(error))
    if len(checks) > 1:
        console.print(
            f"\n{plural(len(checks), 'domain')}: {len(checks) - wrong} right, {wrong} wrong, "
            f"{plural(warned, 'warning')}"
        )
    return MISTAKE if wrong else DONE


def _report(
    console: Console,
    pair: DomainFiles,
    own: Task | None,
    portable_seconds: float | None,
    max_ground_schemas: int | None,
) -> int:
    """Load a domain and print what is in it; return the number of warnings.

    Raises:
        SerpError: Something is wrong.
    """
    from serp.cli.output import learned_from
    from serp.lint.portability import outside_portable_subset
    from serp.lint.rules import warnings_of

    domain, task = _load(pair, own, max_ground_schemas)
    findings = warnings_of(domain)
    fits = None
    if task is not None:
        fits, unfit = _fit(task, asked=own is not None or pair.domain is None)
        findings += unfit
    sources = [s for s in (domain.source, domain.problem_source) if s is not None]
    findings += [finding for source in sources for finding in outside_portable_subset(source)]
    console.print(f"{pair.name}: right", style="bold green")
    for line in _summary(domain):
        console.print(f"  {line}")
    if fits is not None:
        console.print(f"  {fits}")
    if task is not None and fits is not None:
        console.print(f"  {learned_from(domain, task)}")
    for finding in findings[:_WARNINGS]:
        console.print(f"  warning: {finding}", style="yellow")
    if len(findings) > _WARNINGS:
        console.print(f"  ... and {plural(len(findings) - _WARNINGS, 'more warning')}")
    return len(findings) + _ask_unified_planning(console, domain, portable_seconds)


def _ask_unified_planning(console: Console, domain: Domain, seconds: float | None) -> int:
    """Print whether unified-planning reads the files; return the number of warnings."""
    from serp.lint.unified_planning import ask_unified_planning

    if seconds is None:
        console.print("  unified-planning reads it: not asked (--portable asks)")
        return 0
    answer, finding = ask_unified_planning(domain.source, domain.problem_source, seconds)
    console.print(f"  unified-planning reads it: {answer}")
    if finding is None:
        return 0
    console.print(f"  warning: {finding}", style="yellow")
    return 1


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

    Args:
        task: The task.
        asked: Whether the user named it: a task that does not fit is then an error, else a warning.

    Raises:
        SerpError: The user named it, and it does not fit.
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
    yield ", ".join(
        (
            plural(len(model.fluents), "fluent"),
            plural(len(ground.actions), "ground action"),
            plural(len(ground.processes), "process", "processes"),
            plural(len(ground.events), "event"),
            plural(sum(p.role != "goal" for p in model.parameters), "parameter"),
            plural(len(objects), "object"),
        )
    )

    def changing(target: int) -> str:
        names = {
            f"{s.kind.value} {s.schema}": None
            for s in ground.schemas
            if any(effect.target == target for effect in s.effects)
        }
        more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
        return (", ".join([*names][:_NAMED]) or "nothing") + more

    rewarded = changing(REWARD_TARGET)
    good = []
    if ground.goal_rewarded:
        worth = 1.0 if ground.goal_parameter is None else model.theta[ground.goal_parameter]
        good.append(f"the goal, worth {worth:g}")
    if ground.metric is not None:
        good.append(f"the problem's metric, {ground.metric.place.text}")
    rewarded = "; ".join(good) or rewarded
    yield f"unsafe: {changing(UNSAFE_TARGET)}"
    yield f"reward: {rewarded}"
    ends = changing(TERMINAL_TARGET)
    if ground.goal is not None:
        ends = "the problem's goal" + ("" if ends == "nothing" else f", {ends}")
    yield f"terminal: {ends}"
