"""`serp play`: the world of a domain file, step by step or as a place to train in."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp._util.terminal import visible
from serp.ui.options import max_ground_schemas_option, own_task_option, settings_option
from serp.ui.output import examples

if TYPE_CHECKING:
    from serp.model.domain import Domain
    from serp.tasks.task import Task, WorldOptions
    from serp.ui.player import Player, Playground


@click.command(
    "play",
    epilog=examples(
        "serp play delivery.pddl",
        "serp play cartpole --state pole-angle=0.1 --keys left=push-left,right=push-right",
        "serp play delivery.pddl --slip 0.1 --noise 0.05 --seed 3",
        "serp play delivery.pddl --train --slip 0.1 --env-steps 3000 --out runs/delivery",
        "echo 'p 5' | serp play delivery.pddl",
    ),
)
@click.argument("name", metavar="FILE|NAME")
@own_task_option
@click.option("--problem", type=click.Path(path_type=Path), metavar="FILE",
              help="Problem file.  [default: NAME-problem.pddl beside the domain]")  # fmt: skip
@max_ground_schemas_option
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Where it begins, if not as :init says; may be repeated.")  # fmt: skip
@click.option("--failure", type=float, default=0.0, metavar="P",
              help="Probability that an action does nothing.")  # fmt: skip
@click.option("--slip", type=float, default=0.0, metavar="P",
              help="Probability that another applicable action happens instead.")  # fmt: skip
@click.option("--noise", type=float, default=0.0, metavar="S",
              help="What a step changes a number by is off by this share (standard "
                   "deviation).")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the disturbances, and of the training.")  # fmt: skip
@click.option("--dt", type=click.FloatRange(min=0, min_open=True), metavar="X",
              help="Control period.  [default: the task's, else 1]")  # fmt: skip
@click.option("--planner", metavar="NAME", help="Who is asked by `?` and `p`, and trains.  "
                                                "[default: that of the preset]")  # fmt: skip
@settings_option
@click.option("--keys", metavar="KEY=ACTION,...", help="Keys of actions; KEY is a character, or "
                                                       "up, down, left, right, space.")  # fmt: skip
@click.option("--train", is_flag=True, help="Train in this world, instead of playing it by hand.")
@click.option("--env-steps", type=click.IntRange(min=1), metavar="N",
              help="With --train: steps.  [default: by the preset]")  # fmt: skip
@click.option("--episodes", type=click.IntRange(min=1), metavar="N",
              help="With --train: episodes.")  # fmt: skip
@click.option("--max-steps", type=click.IntRange(min=1), default=1000, show_default=True,
              metavar="N", help="With --train: longest episode.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
              help="With --train: folder of the run.  [default: runs/<domain>-world-<time>]",
              )  # fmt: skip
@click.option("--quiet", is_flag=True, help="With --train: print the run's folder alone.")
def command(
    name: str,
    problem: Path | None,
    max_ground_schemas: int | None,
    assignments: tuple[str, ...],
    seed: int,
    keys: str | None,
    train: bool,
    settings: dict[str, dict[str, Any]],
    **options: Any,
) -> int | None:
    """Play the world of a domain file: no environment is needed, and no Python.

    On a terminal a key is an action; what each step changed is shown, and the line of the file
    behind it. `?` asks the planner, `p` lets it act, `u` undoes a step, `:` takes a whole line, `h`
    shows all commands. Elsewhere commands are read from standard input, one a line.

    The planner knows the file. The world may slip and be noisy beside that, so that you see what
    a plan and its vetoes stand.

    With --train a learner practises in this world, and leaves a run behind like any other.
    """
    from serp.errors import SettingsError
    from serp.tasks.registry import find_domain_file
    from serp.tasks.task import WorldOptions
    from serp.ui.asked import asked_domain, asked_own_task
    from serp.ui.player import Playground

    _refuse_unused(train=train, keys=keys)
    try:
        world = WorldOptions(
            **{name: options.pop(name) for name in ("failure", "slip", "noise", "max_steps")}
        )
    except SettingsError as error:
        raise click.UsageError(_as_options(str(error))) from None
    file = find_domain_file(name)
    domain, task = asked_domain(name, file, problem, max_ground_schemas, asked_own_task())
    dt = options.pop("dt") or (task.dt if task is not None else 1.0)
    if (planner := options.pop("planner")) is not None:
        settings.setdefault("planner", {})["name"] = planner
    if train:
        return _train(_begun(domain, assignments), task, world, dt, settings, seed=seed, **options)
    played = Playground(domain, task, dt, settings, own_file=file is not None)
    played.settings()  # what is wrong with them is told at once
    _play(played, world, assignments, keys, seed)
    return None


def _as_options(message: str) -> str:
    """Return a message about settings of the world that calls them as the command does."""
    return re.sub(r"\bworld\.(\w+)", lambda m: f"--{m[1].replace('_', '-')}", message)


def _refuse_unused(*, train: bool, keys: str | None) -> None:
    of_training = ("env_steps", "episodes", "out", "quiet", "max_steps")
    context = click.get_current_context()
    source = click.core.ParameterSource.COMMANDLINE
    for option in of_training:
        if not train and context.get_parameter_source(option) is source:
            raise click.UsageError(f"--{option.replace('_', '-')} is for a training: add --train")
    if train and keys is not None:
        raise click.UsageError("--keys is for playing by hand, without --train")


def _begun(domain: Domain, assignments: tuple[str, ...]) -> Domain:
    """Return a domain whose problem has an `:init`, with what `--state` says."""
    from serp.tasks.file_world import starting
    from serp.ui.asked import parse_state

    given = parse_state(assignments, domain)
    problem = domain.problem_syntax
    if given or problem is None or not problem.has_init:
        return starting(domain, given)
    return domain


def _train(
    domain: Domain,
    task: Task | None,
    world: WorldOptions,
    dt: float,
    settings: dict[str, dict[str, Any]],
    **options: Any,
) -> int | None:
    from serp.errors import SerpError
    from serp.tasks.file_world import world_task
    from serp.ui.trained import train

    if not domain.closed().model.rewarding:
        raise SerpError(
            f"{domain.source.name} says nothing about reward, so there is nothing to learn; write "
            "`(increase (reward) ...)` in an action or event, or a :goal in the problem"
        )
    own = world_task(domain, world, dt)
    if task is not None:  # how far to look is what a task's settings say of its file
        changes = {
            preset: {"planner": values["planner"]}
            for preset, values in task.settings.items()
            if "planner" in values
        }
        own = dataclasses.replace(own, settings=changes, planners=task.planners)
    return train(own, settings=settings, **options)


def _play(
    played: Playground,
    world: WorldOptions,
    assignments: tuple[str, ...],
    keys: str | None,
    seed: int,
) -> None:
    from serp.authoring.play import Game
    from serp.ui.asked import parse_state
    from serp.ui.output import open_console
    from serp.ui.player import Player, action_keys

    domain, dt = played.domain, played.dt
    console = open_console()
    by_hand = sys.stdin.isatty()
    problem = domain.problem_syntax
    unsaid = not assignments and (problem is None or not problem.has_init)
    if unsaid:
        console.print(
            f"{domain.source.name} has no problem with an :init: numbers begin at 0, and all else "
            "is false."
        )
    if unsaid and by_hand:
        assignments = (click.prompt("Other values (FLUENT=VALUE,...)", default="", type=str),)
    game = Game(_begun(domain, assignments), world, dt=dt, seed=seed)
    actions = [action.name for action in game.model.actions]
    begun = parse_state(assignments, domain)
    player = Player(played, game, begun, console, action_keys(actions, keys))
    disturbances = [
        f", {name} {getattr(world, name):g}"
        for name in ("failure", "slip", "noise")
        if getattr(world, name)
    ]
    name = game.moment.domain.source.name
    console.print(f"the world of {name}, control period {dt:g}{''.join(disturbances)}")
    player.print_state()
    player.print_actions()
    if by_hand:
        _by_keys(player)
    else:
        _by_lines(player)


def _by_lines(player: Player) -> None:
    """Read commands from standard input, one a line; a mistake ends the game."""
    from serp.errors import SerpError

    for number, line in enumerate(sys.stdin, 1):
        try:
            if not player.do(line):
                return
        except (SerpError, click.UsageError) as error:
            raise SerpError(f"line {number}: {_message(error)}") from error


def _by_keys(player: Player) -> None:
    """Read keys from the terminal, return repeats the last one; a mistake does not end the game."""
    from serp.errors import SerpError
    from serp.ui.player import typed_keys
    from serp.ui.root import say

    click.secho("? plan  p planner  u undo  r restart  s state  : a line  h help  q quit", dim=True)
    last, keys = "", typed_keys()
    while True:
        click.secho(f"{player.possible()} > ", nl=False, bold=True)
        try:
            key = next(keys)
            line = last if key == "enter" else key
            if not line.startswith(":"):
                click.echo(visible(line))
            last = line
            if not player.do(line):
                return
        except EOFError:
            click.echo()
            return
        except (SerpError, click.UsageError) as error:
            say(_message(error))


def _message(error: Exception) -> str:
    return error.message if isinstance(error, click.UsageError) else str(error)
