"""`serp play`: the world of a domain file, step by step."""

from __future__ import annotations

import contextlib
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp.ui.options import own_task_option, settings_option
from serp.ui.output import examples

if TYPE_CHECKING:
    from serp.ui.player import Player


@click.command(
    "play",
    epilog=examples(
        "serp play delivery.pddl",
        "serp play cartpole --state pole-angle=0.1",
        "serp play delivery.pddl --slip 0.1 --noise 0.05 --seed 3",
        "echo 'p 5' | serp play delivery.pddl",
    ),
)
@click.argument("name", metavar="FILE|NAME")
@own_task_option
@click.option("--problem", type=click.Path(path_type=Path), metavar="FILE",
              help="Problem file.  [default: NAME-problem.pddl beside the domain]")  # fmt: skip
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
              help="Seed of the disturbances.")  # fmt: skip
@click.option("--dt", type=click.FloatRange(min=0, min_open=True), metavar="X",
              help="Control period.  [default: the task's, else 1]")  # fmt: skip
@click.option("--planner", metavar="NAME", help="Who is asked by `?` and `p`.  "
                                                "[default: that of the preset]")  # fmt: skip
@settings_option
def play(
    name: str,
    problem: Path | None,
    assignments: tuple[str, ...],
    seed: int,
    dt: float | None,
    planner: str | None,
    settings: dict[str, dict[str, Any]],
    **disturbances: Any,
) -> None:
    """Play the world of a domain file: no environment is needed, and no Python.

    What each step changed is shown, and the line of the file behind it. A line is a command: the
    number or name of an action; `?` asks the planner, `p` lets it act, `u` undoes a step, `h` shows
    all commands. On a terminal an empty line repeats the last one.

    The planner knows the file. The world may slip and be noisy beside that, so that you see what
    a plan and its vetoes stand.

    `serp plan-and-learn --domain FILE` lets a learner practise in this world.
    """
    from serp.agent.registry import refuse_unknown_names
    from serp.authoring.play import Game
    from serp.errors import SettingsError
    from serp.settings import resolve
    from serp.tasks.file_world import WorldOptions, starting
    from serp.tasks.registry import find_domain_file
    from serp.ui.asked import asked_domain, parse_state
    from serp.ui.output import open_console
    from serp.ui.player import Player

    try:
        world = WorldOptions(**disturbances)
    except SettingsError as error:
        as_options = re.sub(r"\bworld\.(\w+)", r"--\1", str(error))
        raise click.UsageError(as_options) from None
    file = find_domain_file(name)
    domain, task = asked_domain(name, problem)
    if planner is not None:
        settings.setdefault("planner", {})["name"] = planner
    dt = dt or (1.0 if task is None else task.dt)
    resolved = resolve("default", None if task is None else task.settings, settings)
    refuse_unknown_names(resolved, {} if task is None else task.planners)
    console, by_hand = open_console(), sys.stdin.isatty()
    if not assignments and (domain.problem_syntax is None or not domain.problem_syntax.has_init):
        console.print(
            f"{domain.source.name} has no problem with an :init: numbers begin at 0, and all else "
            "is false."
        )
        if by_hand:
            text = click.prompt("Other values (FLUENT=VALUE,...)", default="", type=str)
            assignments = (text,)
    begun = parse_state(assignments, domain)
    game = Game(starting(domain, begun) if begun else domain, world, dt=dt, seed=seed)
    player = Player(domain, task, dt, resolved, file is not None, game, begun, console)
    disturbed = "".join(f", {what} {size:g}" for what, size in disturbances.items() if size)
    console.print(f"the world of {game.domain.source.name}, control period {dt:g}{disturbed}")
    player.print_state()
    player.print_actions()
    if by_hand:
        _prompted(player)
    else:
        _scripted(player)


def _scripted(player: Player) -> None:
    """Read commands from standard input, one a line; a mistake ends the game."""
    from serp.errors import SerpError

    for number, line in enumerate(sys.stdin, 1):
        try:
            if not player.do(line):
                return
        except (SerpError, click.UsageError) as error:
            raise SerpError(f"line {number}: {error}") from error


def _prompted(player: Player) -> None:
    """Ask for commands on the terminal; a mistake does not end the game."""
    from serp.errors import SerpError
    from serp.ui.root import say

    with contextlib.suppress(ImportError):
        import readline  # noqa: F401  (lines can be edited, and called back)
    click.secho("? plan  p planner  u undo  r restart  s state  h help  q quit", dim=True)
    line = ""
    while True:
        try:
            line = input(f"{player.possible()} > ") or line
            if not player.do(line):
                return
        except EOFError:
            click.echo()
            return
        except (SerpError, click.UsageError) as error:
            say(str(error))
