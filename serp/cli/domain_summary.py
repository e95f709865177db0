"""What a domain file that is checked has in it, and what was found."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from serp._util.text import plural
from serp.cli.asked import asked_domain
from serp.cli.output import learned_from
from serp.errors import SerpError, TaskError

if TYPE_CHECKING:
    from serp.lint.domain_pairs import DomainFiles
    from serp.lint.findings import Finding
    from serp.model.loading import Domain
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
    from serp.lint.findings import Finding, examine
    from serp.lint.unified_planning import ask_unified_planning
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
    from serp.lint.domain_pairs import domain_not_found
    from serp.model.loading import load_domain
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
    from serp.lint.task_ranges import out_of_range
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
