"""Options that several commands have."""

from __future__ import annotations

import functools
import re
import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click
from click.core import ParameterSource

from serp.runs import Policy

if TYPE_CHECKING:
    from serp.settings import Changes


def _remember(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
    ctx.meta["serp.ui.options.task"] = value


own_task_option = click.option(
    "--task", metavar="FILE.py|MODULE:FUNCTION", expose_value=False, callback=_remember,
    help="A task that is not installed: a Python file, FILE.py:FUNCTION or MODULE:FUNCTION that "
         "gives a serp.Task. A command that needs no environment ignores it.")  # fmt: skip

domain_option = click.option(
    "--domain", metavar="NAME|FILE",
    help="Installed task, or a domain file of one; any other file is a world, as in "
         "serp play.")  # fmt: skip

settings_option = click.option(
    "--set", "settings", multiple=True, metavar="SECTION.NAME=VALUE",
    callback=lambda ctx, parameter, value: parse_settings(value),
    help="Change a setting; may be repeated.")  # fmt: skip


def own_task_name() -> str | None:
    """Return what `--task` says, or None where it is not given."""
    name: str | None = click.get_current_context().meta.get("serp.ui.options.task")
    return name


def again(command: str, *words: str, domain: str | None = None) -> str:
    """Return a command line that may be typed next, on the task that was given."""
    own = own_task_name()
    given = [*(("--domain", domain) if domain else ()), *(("--task", own) if own else ())]
    return shlex.join(["serp", command, *given, *words])


def policy_of_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument RUN and the options --policy and --task."""
    option = click.option("--policy", type=click.Choice(get_args(Policy)),
                          default="serp", show_default=True,
                          help="serp: the trained policy, within the vetoes; planner: the "
                               "planner alone; learner: the learner alone, no veto. None "
                               "explores.")  # fmt: skip
    run = click.argument("run", type=click.Path(path_type=Path))
    return run(option(own_task_option(command)))


def trials_options(seeds: range, folder: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that gives a command the options of whatever runs trials.

    `folder` is the first part of the name of the default folder.
    """
    options = (
        domain_option,
        own_task_option,
        click.option("--seeds", metavar="N|A-B|A,B",
                     callback=lambda ctx, parameter, value: parse_seeds(value),
                     help=f"How many seeds from {seeds.start} on, or the seeds themselves.  "
                          f"[default: {len(seeds)}]"),
        click.option("--env-steps", type=click.IntRange(min=1), metavar="N",
                     help="Budget of each training."),
        settings_option,
        click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
                     help="Folder of the results; one that is there is continued.  "
                          f"[default: runs/{folder}-<domain>-<time>]"),
        click.option("--jobs", type=click.IntRange(min=1), metavar="N",
                     help="Trainings at the same time.  [default: one a core]"),
        click.option("--engine", metavar="local|ray", default="local", show_default=True,
                     help="What runs the trainings: processes of this machine, or a cluster."),
        click.option("--address", metavar="ADDRESS",
                     help="The cluster of the engine.  [default: the engine starts workers here]"),
        click.option("--quiet", is_flag=True, help="No display; print the result alone."),
    )  # fmt: skip
    return lambda command: functools.reduce(lambda f, option: option(f), options[::-1], command)


def refuse_given(names: Iterable[str], why: str) -> None:
    """Refuse parameters of the command that the user has given; `why` follows their name."""
    context = click.get_current_context()
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"{parameter.opts[0]} {why}", context)


class OutputFile(click.Path):
    """A file to be written, as a `Path`; its name must have one of some endings, such as `.svg`."""

    def __init__(self, *endings: str) -> None:
        super().__init__(path_type=Path)
        self._endings = endings

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; fail if it has another ending."""
        path: Path = super().convert(value, param, ctx)  # type: ignore[assignment]
        if path.suffix.lower() not in self._endings:
            self.fail(f"name a file that ends in {' or '.join(self._endings)}", param, ctx)
        return path


def parse_settings(assignments: Iterable[str]) -> Changes:
    """Return what `--set` changes; see `serp.settings.assigned`."""
    from serp.errors import SettingsError
    from serp.settings import assigned

    try:
        return assigned(assignments)
    except SettingsError as error:
        raise click.UsageError(f"--set {error}") from None


def parse_seeds(text: str | None) -> int | list[int] | None:
    """Return how many seeds, or the seeds themselves, of `--seeds`; None where it is not given."""
    if text is None or text.strip().isdecimal():
        return None if text is None else int(text)
    seeds: list[int] = []
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        chosen = range(int(ends[1]), int(ends[2] or ends[1]) + 1) if ends else ()
        if not 0 < len(chosen) <= 10_000:
            raise click.BadParameter(
                "expected a number, or seeds such as 0-9 or 1,3", param_hint="--seeds"
            )
        seeds += chosen
    return seeds
