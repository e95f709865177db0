"""`serp test`: whether a controller does in given situations what the expert expects."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.text import plural
from serp.errors import SerpError, with_notes
from serp.ui.options import (
    asked_domain,
    asked_own_task,
    asked_settings,
    command,
    dt_option,
    json_option,
    open_run,
    own_task_name,
    own_task_option,
    settings_option,
)
from serp.ui.output import print_json, show
from serp.ui.root import say, working

if TYPE_CHECKING:
    from serp.authoring.scenarios.checking import Decider, Result
    from serp.pddl.source import Source


@command(
    "serp test cartpole",
    "serp test domains/soccer.pddl -k goal",
    "serp test cartpole --run runs/seven",
)
@click.argument("names", metavar="FILE|NAME...", nargs=-1)
@own_task_option
@click.option("-k", "words", default="", metavar="WORDS",
              help="Check only scenarios whose title has these words.")  # fmt: skip
@click.option("--scenarios", "file", type=click.Path(path_type=Path), metavar="FILE",
              help="Another file of scenarios, such as that of a similar domain.")  # fmt: skip
@click.option("--run", type=click.Path(path_type=Path), metavar="RUN",
              help="Use the planner, the vetoes and the learned model of a run.",
              )  # fmt: skip
@click.option("--preset", default="default", show_default=True, metavar="NAME",
              help="default or paper.")  # fmt: skip
@settings_option
@dt_option
@json_option
def test(names: tuple[str, ...], words: str, as_json: bool, **deciding: Any) -> int:
    """Check the scenarios beside domain files.

    The scenarios of NAME.pddl are in NAME.scenarios. A scenario is a situation and what is expected
    in it: what the planner chooses, what is refused and why, an action's value, and its results.
    Without an argument, all scenario files here and in `domains` are checked.

    Exit status: 0 if everything is as expected, 1 if not, or if a file is wrong.
    """
    from serp.authoring.scenarios.checking import run_scenarios

    wrong, results = 0, list[dict[str, Any]]()
    for position, name in enumerate(_domains(names)):
        try:
            with working(f"loading {name or own_task_name()}"):
                source, decider = _opened(name, **deciding)
            if not as_json:
                period = f"control period {decider.model.dt:g}"
                show(("\n" if position else "") + f"{source.name}, {period}", style="bold")
            for result in run_scenarios(source, decider, words):
                place, title = result.scenario.place, result.scenario.title
                failures = [dataclasses.asdict(failure) for failure in result.failures]
                results.append({"file": source.name, "line": place.line, "title": title,
                                "passed": result.passed, "failures": failures})  # fmt: skip
                if not as_json:
                    _print(result)
        except SerpError as error:
            say(with_notes(error), head="Error: ")
            wrong += 1
    passed = sum(result["passed"] for result in results)
    failed = len(results) - passed
    if as_json:
        print_json({"passed": passed, "failed": failed, "wrong": wrong, "scenarios": results})
    elif results:
        total = f"{passed} passed" + (f", {failed} failed" if failed else "")
        total += f", {plural(wrong, 'file')} wrong" if wrong else ""
        show(f"\n{total}", style="bold red" if failed or wrong else "bold green")
    elif not wrong:
        named = f" has the words `{words}` in its title" if words else " is in these files"
        raise SerpError(f"no scenario{named}")
    return 0 if not failed and not wrong else 1


def _domains(names: tuple[str, ...]) -> list[str]:
    """Return the domains to be tested, by name or file; an empty name for that of --task."""
    from serp.authoring.scenarios.syntax import SUFFIX

    if not names and asked_own_task() is not None:
        return [""]
    if names:
        return [
            str(Path(name).with_suffix(".pddl")) if name.endswith(SUFFIX) else name
            for name in names
        ]
    here = [*Path().glob(f"*{SUFFIX}"), *Path("domains").glob(f"*{SUFFIX}")]
    if not here:
        raise click.UsageError(
            "there are no scenario files here; name a domain file or a task: serp test cartpole"
        )
    return [str(file.with_suffix(".pddl")) for file in sorted(here)]


def _opened(
    name: str,
    file: Path | None,
    run: Path | None,
    preset: str,
    settings: Mapping[str, Mapping[str, Any]],
    dt: float | None,
) -> tuple[Source, Decider]:
    """Return the scenarios of a domain, with who decides in them."""
    from serp.authoring.scenarios.checking import Decider, read_beside
    from serp.pddl.source import Source

    domain, task = asked_domain(name)
    source = read_beside(domain) if file is None else Source.read(file)
    if run is not None:
        return source, Decider.of_agent(open_run(run).agent, domain)
    used, period = asked_settings(task, settings, dt, preset)
    return source, Decider.of_domain(source, domain, used, period, task)


def _print(result: Result) -> None:
    mark, style = ("ok  ", "green") if result.passed else ("FAIL", "bold red")
    show(f"  {mark}  {result.scenario.title}", style=style)
    for failure in result.failures:
        show(f"        line {failure.line}: {failure.expected}")
        show(f"          {failure.found}", style="red")
        for action, lines in failure.causes.items():
            for line in lines:
                show(f"            {action}: {line}", style="dim")
