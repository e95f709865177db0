"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from serp.cli.examples import ExampledCommand
from serp.cli.failures import DONE, MISTAKE, say
from serp.cli.output import open_console, plural
from serp.errors import SerpError

if TYPE_CHECKING:
    from rich.console import Console

    from serp.domain.loading import Domain

_SUFFIX = "-problem"


@click.command(
    "check",
    cls=ExampledCommand,
    short_help="Say whether domain files are right, and what to mend.",
    examples=[
        "serp check domains/cartpole.pddl",
        "serp check cartpole",
        "serp check domains/*.pddl",
    ],
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1, required=True)
@click.pass_context
def command(ctx: click.Context, domains: tuple[str, ...]) -> int:
    """Check domain and problem files: say what is wrong and where, or what is in them.

    A problem file is checked with its domain: `<name>-problem.pddl` with `<name>.pddl`, any other
    with the given domain that it names, or with `domain.pddl` beside it.

    Every file is checked, even where one before it is wrong. Warnings (what may have been
    forgotten, and what other PDDL tools refuse) leave the exit status 0.
    """
    console = open_console()
    wrong = warned = 0
    checks = list(_checks(domains))
    for position, check in enumerate(checks):
        if position:
            console.print("")
        try:
            warned += _report(console, check)
        except SerpError as error:
            wrong += 1
            console.print(f"{check.name}: wrong", style="bold red")
            say(str(error))
    if len(checks) > 1:
        console.print(
            f"\n{plural(len(checks), 'domain')}: {len(checks) - wrong} right, {wrong} wrong, "
            f"{plural(warned, 'warning')}"
        )
    return MISTAKE if wrong else DONE


class _Check(NamedTuple):
    """One domain to check: as it was given, its file, and the problem file where one was given."""

    name: str
    domain: Path | None
    problem: Path | None


def _checks(names: Iterable[str]) -> Iterator[_Check]:
    """Resolve what was given into domains with their problems, each pair once."""
    from serp.errors import TaskError
    from serp.registry import find_domain_file

    given: list[tuple[str, Path | None]] = []
    for name in names:
        try:
            given.append((name, find_domain_file(name)))
        except TaskError:  # a file that is missing: loading it says so
            given.append((name, Path(name)))
    domains = [path for _, path in given if path is not None and not _is_problem(path)]
    seen: set[tuple[Path | str, Path | None]] = set()
    for name, path in given:
        check = _Check(name, path, None)
        if path is not None and _is_problem(path):
            check = _Check(name, _domain_of(path, domains), path)
        elif path is not None:
            sibling = path.with_name(f"{path.stem}{_SUFFIX}.pddl")
            check = _Check(name, path, sibling if sibling.is_file() else None)
        key = (check.domain.resolve() if check.domain else name,
               check.problem.resolve() if check.problem else None)  # fmt: skip
        if key not in seen:
            seen.add(key)
            yield check


def _is_problem(path: Path) -> bool:
    if path.stem.endswith(_SUFFIX):
        return True
    return _title(path)[:1] == ("problem",)


def _title(path: Path) -> tuple[str, ...]:
    """Return (`domain` or `problem`, name) of a file; nothing where it cannot be read."""
    from serp.domain.sexpr import Group, Word, read_group
    from serp.domain.source import Source

    try:
        items = read_group(Source.read(path)).items
    except SerpError:
        return ()
    title = items[1] if len(items) > 1 else None
    if not isinstance(title, Group):
        return ()
    return tuple(word.text for word in title.items if isinstance(word, Word))


def _domain_of(problem: Path, given: Sequence[Path]) -> Path | None:
    """Return the domain file that a problem file is to be checked with, or None."""
    if problem.stem.endswith(_SUFFIX):
        return problem.with_name(f"{problem.stem.removesuffix(_SUFFIX)}.pddl")
    wanted = _named_domain(problem)
    for path in given:
        if _title(path) == ("domain", wanted):
            return path
    beside = problem.with_name("domain.pddl")
    return beside if beside.is_file() else None


def _named_domain(problem: Path) -> str:
    from serp.domain.sexpr import Group, Word, read_group
    from serp.domain.source import Source

    for section in read_group(Source.read(problem)).items[2:]:
        if isinstance(section, Group) and section.head == ":domain" and len(section.items) == 2:
            word = section.items[1]
            return word.text if isinstance(word, Word) else ""
    return ""


def _report(console: Console, check: _Check) -> int:
    """Load a domain and print what is in it; return the number of warnings.

    Raises:
        SerpError: Something is wrong.
    """
    from serp.cli.warnings_of import warnings_of
    from serp.portability import outside_portable_subset, refused_by_unified_planning

    domain = _load(check)
    findings = warnings_of(domain)
    sources = [s for s in (domain.source, domain.problem_source) if s is not None]
    strange = [finding for source in sources for finding in outside_portable_subset(source)]
    refused = refused_by_unified_planning(domain.source, domain.problem_source)
    console.print(f"{check.name}: right", style="bold green")
    for line in _summary(domain):
        console.print(f"  {line}")
    console.print(f"  unified-planning reads it: {'no' if refused else 'yes'}")
    findings += [*strange, *([refused] if refused else [])]
    for finding in findings:
        console.print(f"  warning: {finding}", style="yellow")
    return len(findings)


def _load(check: _Check) -> Domain:
    from serp.domain.loading import load_domain
    from serp.registry import load_task

    if check.domain is not None:
        return load_domain(check.domain, check.problem)
    if check.problem is not None:
        raise SerpError(
            f"{check.problem}: a problem file, and its domain file is not known; give both, as in "
            f"`serp check domain.pddl {check.problem}`"
        )
    if Path(check.name).is_dir():
        raise SerpError(f"{check.name} is a folder; give the files in it, such as `*.pddl`")
    return load_task(check.name).load()


def _summary(domain: Domain) -> Iterator[str]:
    from serp.domain.automorphisms import find_symmetries
    from serp.domain.ground import REWARD_TARGET, TERMINAL_TARGET, UNSAFE_TARGET, GroundSchema

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
            plural(len(model.parameters), "literal"),
            plural(len(objects), "object"),
        )
    )

    def changing(target: int) -> str:
        schemas: Sequence[GroundSchema] = (*ground.actions, *ground.processes, *ground.events)
        names = {
            f"{s.kind.value} {s.schema}": None
            for s in schemas
            if any(effect.target == target for effect in s.effects)
        }
        return ", ".join(names) or "nothing"

    rewarded = changing(REWARD_TARGET)
    if ground.metric is not None:
        rewarded = f"the problem's metric, {ground.metric.place.text}"
    yield f"unsafe: {changing(UNSAFE_TARGET)}"
    yield f"reward: {rewarded}"
    ends = changing(TERMINAL_TARGET)
    if ground.goal is not None:
        ends = "the problem's goal" + ("" if ends == "nothing" else f", {ends}")
    yield f"terminal: {ends}"
    symmetries = find_symmetries(ground)
    for symmetry in symmetries.told():
        yield f"symmetry: {symmetry}"
    if not symmetries.complete:
        yield "symmetry: the search was given up, there may be more"
