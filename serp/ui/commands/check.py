"""`serp check`: the findings about domain files, and what the files define."""

from __future__ import annotations

import contextlib
import functools
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from serp._util.did_you_mean import listed
from serp._util.text import plural
from serp.errors import SerpError, TaskError
from serp.ui.options import (
    asked_own_task,
    command,
    json_option,
    own_task_name,
    own_task_option,
    with_domain,
)
from serp.ui.output import show
from serp.ui.root import say

if TYPE_CHECKING:
    from serp.authoring.lint.domain_pairs import DomainFiles
    from serp.authoring.lint.findings import Finding
    from serp.model.domain import Domain
    from serp.pddl.source import DomainWarning
    from serp.tasks.environment import BoundTask
    from serp.tasks.task import Task


@command(
    "serp check domains/cartpole.pddl",
    "serp check --task my_robot.py",
    "serp check domains/*.pddl --json > findings.json",
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1)
@own_task_option
@json_option
def check(domains: tuple[str, ...], as_json: bool) -> int:
    """Check domain and problem files: all mistakes, and a summary.

    A problem file is checked with its domain file: a given file with the domain that it names, else
    `<name>.pddl` beside `<name>-problem.pddl`, else `domain.pddl`.

    If a file belongs to a task (an installed one, or --task), the task's environment is created, to
    check whether grounding and actions fit the file. It is neither reset nor stepped.

    Every file is checked, even if an earlier one has errors. Warnings (what may have been
    forgotten) and notes (such as what other PDDL tools refuse) leave the exit status 0. The
    comment `; serp: ignore[code]` silences one.
    """
    from serp.authoring.lint.domain_pairs import DomainFiles, pairs

    own = asked_own_task()
    if not domains and own is None:
        raise click.UsageError("give files, names of installed tasks, or --task")
    for name in domains:
        if name.endswith(".py"):
            raise click.UsageError(f"{name} is a Python file; give it with --task {name}")
    asked = pairs(domains) if domains else [DomainFiles(str(own_task_name()), None, None)]
    checks: list[_CheckedDomain] = []
    for pair in asked:
        checks.append(_checked(pair, own))
        if not as_json:
            _print(checks[-1], first=len(checks) == 1)
    wrong = sum(check.count_of("error") > 0 for check in checks)
    if as_json:
        findings = [finding.as_dict() for check in checks for finding in check.findings]
        click.echo(json.dumps(findings, indent=2, ensure_ascii=False))
        for check in checks:
            if check.failure:
                say(check.failure)
    elif len(checks) > 1:
        warnings = plural(sum(check.count_of("warning") for check in checks), "warning")
        show(f"\n{plural(len(checks), 'domain')}: {wrong} wrong, {warnings}")
    return 1 if wrong else 0


class _CheckedDomain(NamedTuple):
    """The result for one domain; `summary` are lines about one without errors.

    `failure` says why it could not be checked; it is empty where it was.
    """

    name: str
    findings: Sequence[Finding]
    summary: Sequence[str]
    failure: str = ""

    def count_of(self, severity: str) -> int:
        """Return the number of findings of a severity; a failure is an error."""
        count = sum(finding.severity == severity for finding in self.findings)
        return count + (severity == "error" and bool(self.failure))


def _checked(pair: DomainFiles, own: Task | None) -> _CheckedDomain:
    """Check a domain, and the task that it belongs to."""
    from serp.authoring.lint.findings import Finding, examine
    from serp.pddl.source import DomainError

    summary: list[str] = []
    try:
        if pair.domain is not None:
            look = functools.partial(_look, summary, pair.domain, own)
            observed = own is not None and not own.closed
            found = examine(pair.domain, pair.problem, look=look, observed=observed).findings
        else:
            task = _named_task(pair, own)
            domain = task.load()
            look = functools.partial(_look, summary, None, task)
            observed, files = not task.closed, (domain.source, domain.problem_source)
            found = examine(*files, look=look, observed=observed).findings
    except DomainError as error:
        found = [] if pair.domain is None else examine(pair.domain, pair.problem).findings
        found = found or [Finding.of(error)]
    except SerpError as error:
        return _CheckedDomain(pair.name, (), (), str(error))
    return _CheckedDomain(pair.name, found, summary)


def _named_task(pair: DomainFiles, own: Task | None) -> Task:
    """Return the task that is given instead of a domain file."""
    from serp.authoring.lint.domain_pairs import domain_not_found
    from serp.pddl.source import DomainError, Source
    from serp.tasks.registry import load_task

    if pair.problem is not None:
        raise domain_not_found(Source.read(pair.problem))
    if own is None and Path(pair.name).is_dir():
        raise DomainError(
            f"{pair.name} is a folder; give the files in it, such as `*.pddl`",
            code="unreadable-file",
        )
    return own or load_task(pair.name)


def _look(
    summary: list[str], file: Path | None, asked: Task | None, domain: Domain
) -> Iterator[DomainWarning]:
    """Sum a domain up, and yield warnings about the task that it belongs to.

    A task that does not fit is an error if the user `asked` for it, else a warning.
    """
    from serp.tasks.registry import task_of

    task = None if asked is None else with_domain(asked, domain)
    if file is not None and asked is None:
        with contextlib.suppress(TaskError):  # the package that offers it fails
            task = task_of(domain, file)
    if task is None:
        summary += _summary(domain)
        return
    from serp.authoring.lint.task_ranges import out_of_range
    from serp.pddl.source import DomainWarning

    try:
        with task.bind() as bound:
            summary += [*_summary(bound.domain), *_fit(bound)]
            yield from out_of_range(bound)
    except SerpError as error:
        if asked is not None:
            raise
        summary += _summary(task.load())
        yield DomainWarning(str(error), code="task-mismatch")


def _fit(bound: BoundTask) -> Iterator[str]:
    """Yield what was checked of a task, and what may be missing in it."""
    yield f"task {bound.name}: spaces, grounding and actions fit together; no step was tried"
    groups, ground = bound.actions.groups, bound.model.actions
    if unnamed := [str(k) for k, group in enumerate(groups) if not group]:
        named = [listed(dict.fromkeys(ground[k].schema for k in group)) for group in groups]
        twice = [f"; action {k} has several: {own}" for k, own in enumerate(named) if "," in own]
        yield f"the file has no name for environment action {listed(unnamed)}{''.join(twice)}"
    if not bound.time_limited:
        yield "the environment declares no time limit; training.episode_steps truncates episodes"


def _summary(domain: Domain) -> Iterator[str]:
    from serp.model.ground_model import REWARD_TARGET, TERMINAL_TARGET, UNSAFE_TARGET

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
        """Return the schemas that change a target."""
        changed = (s for s in ground.schemas if any(e.target == target for e in s.possible_effects))
        return [*dict.fromkeys(f"{s.kind.value} {s.schema}" for s in changed)]

    rewarded = []
    if ground.goal_rewarded:
        worth = 1.0 if ground.goal_parameter is None else model.theta[ground.goal_parameter]
        rewarded = [f"the goal, worth {worth:g}"]
    if ground.metric is not None:
        rewarded.append(f"the problem's metric, {ground.metric.place.text}")
    ends = ["the problem's goal"] if ground.goal is not None else []
    ends += [listed(changing(TERMINAL_TARGET))] if changing(TERMINAL_TARGET) else []
    yield f"unsafe: {listed(changing(UNSAFE_TARGET)) or 'nothing'}"
    yield f"reward: {'; '.join(rewarded) or listed(changing(REWARD_TARGET)) or 'nothing'}"
    yield f"terminal: {', '.join(ends) or 'nothing'}"


def _print(check: _CheckedDomain, *, first: bool) -> None:
    counts = {kind: check.count_of(kind) for kind in ("error", "warning", "note")}
    wrong, warned = counts["error"], counts["warning"]
    style = "bold red" if wrong else "bold yellow" if warned else "bold green"
    parts = [plural(count, kind) for kind, count in counts.items() if count]
    headline = ", ".join(parts if wrong else ["well formed", *parts])
    if check.failure:
        headline = "not checked"
    show("\n" * (not first) + f"{check.name}: {headline}", style=style)
    if check.failure:
        say(check.failure)
    remarks = [finding for finding in check.findings if finding.severity != "error"]
    for finding in check.findings:
        if finding.severity == "error":
            say(finding.rendered)
    for line in check.summary:
        show(f"  {line}")
    for finding in remarks:
        style = "yellow" if finding.severity == "warning" else "dim"
        show(f"  {finding.severity}: {finding.rendered}", style=style)
