"""Options that several commands have, and options as one record."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar, get_args

import click

from serp.training.policies import Policy

_Record = TypeVar("_Record")
_Result = TypeVar("_Result")
_KEY = f"{__name__}.task"


def _remember(ctx: click.Context, parameter: click.Parameter, value: str | None) -> None:
    ctx.meta[_KEY] = value


own_task_option = click.option(
    "--task", metavar="FILE.py|MODULE:FUNCTION", expose_value=False, callback=_remember,
    help="A task that is not installed: a Python file, FILE.py:FUNCTION or MODULE:FUNCTION that "
         "gives a serp.Task.")  # fmt: skip

max_ground_schemas_option = click.option(
    "--max-ground-schemas", type=click.IntRange(min=1), metavar="N",
    help="Most ground actions, processes and events.  [default: 50000]")  # fmt: skip


def own_task_name() -> str | None:
    """Return what `--task` says, or None where it is not given."""
    name: str | None = click.get_current_context().meta.get(_KEY)
    return name


def policy_of_run(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument RUN and the options --policy and --task."""
    option = click.option("--policy", type=click.Choice(get_args(Policy)),
                          default="serp", show_default=True,
                          help="serp: the learner's choice within the vetoes; planner: the "
                               "planner alone; learner: the learner alone, no veto; training: who "
                               "acts in training, planner or learner, within the vetoes. None "
                               "explores.")  # fmt: skip
    run = click.argument("run", type=click.Path(path_type=Path))
    return run(option(own_task_option(command)))


def as_record(
    record: type[_Record],
) -> Callable[[Callable[[click.Context, _Record], _Result]], Callable[..., _Result]]:
    """Pass the context and all options, in one record, to a command.

    Args:
        record: Takes the options by name.
    """

    def decorate(command: Callable[[click.Context, _Record], _Result]) -> Callable[..., _Result]:
        @click.pass_context
        @functools.wraps(command)
        def with_record(ctx: click.Context, /, **options: Any) -> _Result:
            return command(ctx, record(**options))

        return with_record

    return decorate


def parse_settings(assignments: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return section → setting → value of `section.name=value` texts.

    Values are JSON where they can be (numbers, true, false, null, lists), else text; `inf` is the
    infinity and `none` is null. Whether section and setting exist is for `serp.Settings` to say.

    Raises:
        UsageError: A text has another form, or a setting is given twice.
    """
    settings: dict[str, dict[str, Any]] = {}
    for text in assignments:
        target, equals, value = text.partition("=")
        section, dot, name = (part.strip() for part in target.partition("."))
        if not (equals and dot and section and name):
            raise click.UsageError(
                f"--set {text}: expected section.name=value, such as planner.depth=7"
            )
        if name in settings.setdefault(section, {}):
            raise click.UsageError(f"--set {section}.{name} is given twice")
        settings[section][name] = _setting(value.strip())
    return settings


def _setting(text: str) -> Any:
    if text in ("inf", "none", "None", "True", "False"):
        words = {"inf": float("inf"), "True": True, "False": False}
        return words.get(text)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return text
    return tuple(value) if isinstance(value, list) else value
