"""`serp check`: whether domain files are right, what is in them, and what may be missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.cli.examples import ExampledCommand
from serp.cli.failures import DONE, MISTAKE, say
from serp.cli.output import open_console, plural
from serp.errors import SerpError

if TYPE_CHECKING:
    from rich.console import Console

    from serp.cli.pairs import Pair
    from serp.domain.loading import Domain

_NAMED = 12  # actions, processes and events that one line names
_WARNINGS = 100  # warnings of one domain that are printed


@click.command(
    "check",
    cls=ExampledCommand,
    short_help="Say whether domain files are right, and what to mend.",
    examples=[
        "serp check domains/cartpole.pddl",
        "serp check cartpole",
        "serp check domains/*.pddl",
        "serp check domain.pddl p01.pddl --portable",
    ],
)
@click.argument("domains", metavar="FILE|NAME...", nargs=-1, required=True)
@click.option("--portable", is_flag=True,
              help="Ask unified-planning as well whether it reads the files.")  # fmt: skip
@click.option("--portable-seconds", type=click.FloatRange(min=0, min_open=True), default=60.0,
              show_default=True, metavar="S", help="Most seconds to wait for it.")  # fmt: skip
def command(domains: tuple[str, ...], portable: bool, portable_seconds: float) -> int:
    """Check domain and problem files: say what is wrong and where, or what is in them.

    A problem file is checked with its domain: the given file of the domain that it names, or else
    `<name>.pddl` beside `<name>-problem.pddl`, or `domain.pddl`.

    Every file is checked, even where one before it is wrong. Warnings (what may have been
    forgotten, and what other PDDL tools refuse) leave the exit status 0.
    """
    from serp.cli.pairs import pairs

    console = open_console()
    wrong = warned = 0
    checks = pairs(domains)
    for position, check in enumerate(checks):
        if position:
            console.print("")
        try:
            warned += _report(console, check, portable_seconds if portable else None)
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


def _report(console: Console, pair: Pair, portable_seconds: float | None) -> int:
    """Load a domain and print what is in it; return the number of warnings.

    Raises:
        SerpError: Something is wrong.
    """
    from serp.cli.rewards import learned_from_by
    from serp.cli.warnings_of import warnings_of
    from serp.portability import outside_portable_subset

    domain = _load(pair)
    findings = warnings_of(domain)
    sources = [s for s in (domain.source, domain.problem_source) if s is not None]
    findings += [finding for source in sources for finding in outside_portable_subset(source)]
    console.print(f"{pair.name}: right", style="bold green")
    for line in _summary(domain):
        console.print(f"  {line}")
    if learned := learned_from_by(domain, pair.domain or Path(domain.source.name)):
        console.print(f"  {learned}")
    for finding in findings[:_WARNINGS]:
        console.print(f"  warning: {finding}", style="yellow")
    if len(findings) > _WARNINGS:
        console.print(f"  ... and {plural(len(findings) - _WARNINGS, 'more warning')}")
    return len(findings) + _ask_unified_planning(console, domain, portable_seconds)


def _ask_unified_planning(console: Console, domain: Domain, seconds: float | None) -> int:
    """Print whether unified-planning reads the files; return the number of warnings."""
    from serp.portability import ask_unified_planning

    if seconds is None:
        console.print("  unified-planning reads it: not asked (--portable asks)")
        return 0
    answer, finding = ask_unified_planning(domain.source, domain.problem_source, seconds)
    console.print(f"  unified-planning reads it: {answer}")
    if finding is None:
        return 0
    console.print(f"  warning: {finding}", style="yellow")
    return 1


def _load(pair: Pair) -> Domain:
    from serp.domain.loading import load_domain
    from serp.registry import load_task

    if pair.domain is not None:
        return load_domain(pair.domain, pair.problem)
    if pair.problem is not None:
        raise SerpError(
            f"{pair.problem}: a problem file, and its domain file is not known; give both, as in "
            f"`serp check domain.pddl {pair.problem}`"
        )
    if Path(pair.name).is_dir():
        raise SerpError(f"{pair.name} is a folder; give the files in it, such as `*.pddl`")
    return load_task(pair.name).load()


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
        more = f" and {len(names) - _NAMED:,} more" if len(names) > _NAMED else ""
        return (", ".join([*names][:_NAMED]) or "nothing") + more

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
