"""Options that several commands have, and what they mean: a task, a domain, a run, a state."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import shlex
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import click
from click.core import ParameterSource

from serp._util.did_you_mean import did_you_mean
from serp.errors import SerpError
from serp.runs import Policy
from serp.ui.output import examples

if TYPE_CHECKING:
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.model.domain import Domain
    from serp.model.transition_model import Vector
    from serp.planning.replanner import MonitorReplanner, Plan
    from serp.runs.run import Run
    from serp.settings import Changes, Settings
    from serp.tasks.environment import BoundTask
    from serp.tasks.task import Task

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

_TASK = f"{__name__}.task"
_SETTINGS = f"{__name__}.settings"
_TRUSTED = "tasks.json"


own_task_option = click.option(
    "--task", metavar="FILE.py|MODULE:FUNCTION", expose_value=False,
    callback=lambda ctx, parameter, value: ctx.meta.update({_TASK: value}),
    help="A task that is not installed: a Python file, FILE.py:FUNCTION or MODULE:FUNCTION that "
         "returns a serp.Task. Commands that need no environment ignore this option.")  # fmt: skip

domain_option = click.option(
    "--domain", metavar="NAME|FILE",
    help="An installed task or a domain file. If no task belongs to the file, SErP simulates "
         "the file's world, as in serp play.")  # fmt: skip

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
    help="serp: the trained policy, with vetoes; planner: the planner alone; learner: the learner "
         "alone, without vetoes. No policy explores.")  # fmt: skip


def command(*lines: str) -> Callable[[Callable[..., Any]], click.Command]:
    """Return the decorator of a command with the name of its function; its help ends with examples.

    Whatever runs a command is to import little, so a command imports what it needs when it runs.
    """
    return click.command(epilog=examples(*lines))


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


def again(command: str, *words: str, domain: str | None = None, run: Run | None = None) -> str:
    """Return a command line to type next, on the given task, or a run, which remembers its file."""
    own = None if run is not None and run.made.code else own_task_name()
    words = words if run is None else (str(run.path), *words)
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
    """A file to be written, as a `Path`; its name must have an ending, such as `.svg`."""

    def __init__(self, ending: str) -> None:
        super().__init__(path_type=Path)
        self._ending = ending

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; fail if it has another ending."""
        path: Path = super().convert(value, param, ctx)  # type: ignore[assignment]
        if path.suffix.lower() != self._ending:
            self.fail(f"name a file that ends in {self._ending}", param, ctx)
        return path


def parse_settings(assignments: Iterable[str]) -> Changes:
    """Return what `--set` changes; see `serp.settings.assigned`."""
    from serp.errors import SettingsError
    from serp.settings import assigned

    try:
        return assigned(assignments)
    except SettingsError as error:
        raise click.UsageError(f"--set {error}") from None


# What the options mean --------------------------------------------------------------------------


def asked_own_task() -> Task | None:
    """Return the task that `--task` names, or None where it is not given."""
    if (name := own_task_name()) is None:
        return None
    from serp.tasks.registry import custom_task

    task = custom_task(name)
    if task.code:
        _trust(_file_of(task.code))
    return task


def recorded_task(folder: Path) -> Task | None:
    """Return the task that a run was made of by `--task FILE.py`, or None for any other run.

    It is code. The user is asked before a file runs which they have not run before, or which has
    changed since.
    """
    from serp.runs.run_config import read_metadata
    from serp.tasks.registry import custom_task

    code = read_metadata(folder)[1].code
    if not code or not (file := _file_of(code)).is_file():
        return None
    if _trusted().get(str(file)) != _digest(file):
        give = f"{folder} was made with {file}. You have not run this file yet, or it has changed."
        if not sys.stdin.isatty():
            raise SerpError(f"{give} To run it, add --task {shlex.quote(code)}")
        click.confirm(f"{give} Run it?", abort=True, err=True)
        _trust(file)
    return custom_task(code)


def _file_of(code: str) -> Path:
    return Path(code[: code.rindex(".py") + 3])


def _trusted() -> dict[str, str]:
    """Return the task files that the user has run: file → digest."""
    try:
        read = json.loads((Path(click.get_app_dir("serp")) / _TRUSTED).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return read if isinstance(read, dict) else {}


def _trust(file: Path) -> None:
    """Remember that the user has run a task file; without a writable home they are asked again."""
    from serp._util.files import write_durably

    known, digest = _trusted(), _digest(file)
    if known.get(str(file)) != digest:
        folder = Path(click.get_app_dir("serp"))
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            write_durably(folder / _TRUSTED, json.dumps({**known, str(file): digest}))


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def asked_task(domain: str | None) -> Task:
    """Return the task that `--task` and `--domain` mean together.

    `--domain` is an installed task or a domain file; beside `--task`, another domain file for it.
    """
    from serp.tasks.registry import find_domain_file, find_task

    task = asked_own_task()
    if task is None:
        return find_task(_given(domain))
    if domain is None:
        return task
    file = find_domain_file(domain)
    if file is None:
        raise SerpError(f"--domain {domain}: with --task, this must be a domain file, not a task")
    return with_domain(task, file)


def asked_domain(name: str | None, problem: Path | None = None) -> tuple[Domain, Task | None]:
    """Return a domain and the task that it belongs to, with that domain; None for no task.

    `name` is a domain file, or that of an installed task, for which the task of `--task` stands.
    The problem is by default the one that belongs to the domain.
    """
    from serp.model.domain import load_domain
    from serp.tasks.registry import find_domain_file, load_task, task_of

    own = asked_own_task()
    file = find_domain_file(name) if name else None
    if file is None:
        task = own or load_task(_given(name))
        domain = task.load()
        if problem is not None:
            domain = load_domain(domain.source.name, problem, observed=not task.closed)
        return domain, with_domain(task, domain)
    domain = load_domain(file, problem)
    belonging = task_of(domain, file) if own is None else with_domain(own, domain)
    return domain if belonging is None else belonging.load(), belonging


def _given(domain: str | None) -> str:
    if not domain:
        raise click.UsageError("give --domain (`serp list` names the tasks) or --task")
    return domain


def with_domain(task: Task, domain: Domain | Path) -> Task:
    """Return a task with a domain in place of its own."""
    return dataclasses.replace(task, domain=domain, problem=None)


def asked_settings(
    task: Task | None, changes: Changes, dt: float | None, preset: str = "default"
) -> tuple[Settings, float]:
    """Return the settings of a decision on a task, or on none, and its control period."""
    from serp.settings import resolve

    settings = resolve(preset, None if task is None else task.settings, changes)
    return settings, dt or (1.0 if task is None else task.dt)


def open_run(folder: Path) -> Run:
    """Open a run with the task of `--task`, or with the one that it was made of."""
    from serp.runs.run import load_run

    return load_run(folder, asked_own_task() or recorded_task(folder))


def rolled_out(
    bound: BoundTask, planner: ChosenPlanner | MonitorReplanner, seed: int
) -> Iterator[tuple[Vector, Plan, bool]]:
    """Let a planner act in an environment, without end; yield each state, plan, and episode's end.

    The plan of a state at the end is not carried out.
    """
    (raw, info), over = bound.reset(seed), False
    while True:
        state = bound.ground(raw, info, bound.env)
        plan = planner.plan(state)
        over = over or plan.action is None
        yield state, plan, over
        if over or plan.action is None:
            (raw, info), over = bound.reset(), False
            continue
        action = bound.actions.environment_action[plan.action]
        raw, _, terminated, truncated, info = bound.step(action)
        over = terminated or truncated


def parse_state(
    assignments: Iterable[str], domain: Domain, option: str = "--state"
) -> dict[str, float]:
    """Return fluent → value of `fluent=value` texts, several in one text separated by commas.

    A predicate takes `true` or `false` as well as 1 or 0. `option` begins the messages.
    """
    state: dict[str, float] = {}
    for text in (part for whole in assignments for part in whole.split(",") if part.strip()):
        target, equals, value = text.partition("=")
        if not equals or not target.strip():
            raise click.UsageError(
                f"{option} {text}: expected fluent=value, such as pole-angle=0.05"
            )
        name = " ".join(target.lower().strip().strip("()").split())
        declaration = domain.declared(name)
        if declaration is None:
            model = domain.model
            known = [*(fluent.name for fluent in model.fluents), *model.ground.static]
            raise SerpError(f"{option}: unknown fluent `{name}`; {did_you_mean(name, known)}")
        if name in state:
            raise SerpError(f"{option}: `{name}` is given twice")
        state[name] = _value(name, value.strip(), option, numeric=declaration.numeric)
    return state


def _value(name: str, text: str, option: str, *, numeric: bool) -> float:
    words = {} if numeric else {"true": 1.0, "false": 0.0}
    try:
        value = words[text.lower()] if text.lower() in words else float(text.replace("−", "-"))
    except ValueError:
        value = float("nan")
    if value - value != 0.0 or (not numeric and value not in (0.0, 1.0)):
        wanted = "a finite number" if numeric else "true or false"
        raise SerpError(f"{option}: `{name}` is {wanted}, not `{text}`")
    return value
