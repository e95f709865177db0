"""Options that several commands have."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click
from click.core import ParameterSource

from serp.runs import Policy

if TYPE_CHECKING:
    from serp.settings import Changes

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

_TASK = f"{__name__}.task"
_SETTINGS = f"{__name__}.settings"


def _remember(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
    ctx.meta[_TASK] = value


own_task_option = click.option(
    "--task", metavar="FILE.py|MODULE:FUNCTION", expose_value=False, callback=_remember,
    help="A task that is not installed: a Python file, FILE.py:FUNCTION or MODULE:FUNCTION that "
         "gives a serp.Task. A command that needs no environment ignores it.")  # fmt: skip

domain_option = click.option(
    "--domain", metavar="NAME|FILE",
    help="Installed task, or a domain file of one; any other file is a world, as in "
         "serp play.")  # fmt: skip

problem_option = click.option(
    "--problem", type=click.Path(path_type=Path), metavar="FILE",
    help="Problem file.  [default: NAME-problem.pddl beside the domain]")  # fmt: skip

settings_option = click.option(
    "--set", "settings", multiple=True, metavar="SECTION.NAME=VALUE",
    callback=lambda ctx, parameter, value: parse_settings([*ctx.meta.get(_SETTINGS, ()), *value]),
    help="Change a setting; may be repeated.")  # fmt: skip

dt_option = click.option(
    "--dt", type=click.FloatRange(min=0, min_open=True), metavar="X",
    help="Control period.  [default: the task's, else 1]")  # fmt: skip

json_option = click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")

policy_option = click.option(
    "--policy", type=click.Choice(get_args(Policy)), default="serp", show_default=True,
    help="serp: the trained policy, within the vetoes; planner: the planner alone; learner: the "
         "learner alone, no veto. None explores.")  # fmt: skip


def run_argument(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument RUN and the option --task."""
    return click.argument("run", type=click.Path(path_type=Path))(own_task_option(command))


def seed_option(what: str) -> Decorator:
    """Return the option of a seed; `what` is its help."""
    return click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True,
                        metavar="N", help=what)  # fmt: skip


def setting_option(option: str, setting: str, *, metavar: str, what: str) -> Decorator:
    """Return an option that is short for `--set` of a setting; `what` is its help."""

    def short(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
        if value is not None:
            ctx.meta.setdefault(_SETTINGS, []).append(f"{setting}={value}")

    # Eager, so that it is known when `--set` is read.
    return click.option(option, metavar=metavar, help=what, callback=short, is_eager=True,
                        expose_value=False)  # fmt: skip


def own_task_name() -> str | None:
    """Return what `--task` says, or None where it is not given."""
    name: str | None = click.get_current_context().meta.get(_TASK)
    return name


def again(command: str, *words: str, domain: str | None = None) -> str:
    """Return a command line that may be typed next, on the task that was given."""
    own = own_task_name()
    given = [*(("--domain", domain) if domain else ()), *(("--task", own) if own else ())]
    return shlex.join(["serp", command, *given, *words])


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
