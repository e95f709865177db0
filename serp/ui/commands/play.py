"""`serp play`: the world of a domain file, step by step."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from serp.ui.options import (
    asked_domain,
    asked_settings,
    command,
    dt_option,
    own_task_option,
    parse_state,
    problem_option,
    seed_option,
    setting_option,
    settings_option,
)
from serp.ui.output import show


@command(
    "serp play delivery.pddl",
    "serp play cartpole --state pole-angle=0.1",
    "serp play delivery.pddl --slip 0.1 --noise 0.05 --seed 3",
    "echo 'p 5' | serp play delivery.pddl",
)
@click.argument("name", metavar="FILE|NAME")
@own_task_option
@problem_option
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Initial values that differ from :init; may be repeated.")  # fmt: skip
@click.option("--failure", type=float, default=0.0, metavar="P",
              help="Probability that an action does nothing.")  # fmt: skip
@click.option("--slip", type=float, default=0.0, metavar="P",
              help="Probability that another applicable action happens instead.")  # fmt: skip
@click.option("--noise", type=float, default=0.0, metavar="S",
              help="Relative error in each change to a number (standard deviation).")  # fmt: skip
@seed_option("Seed of the disturbances.")
@dt_option
@setting_option("--planner", "planner.name", metavar="NAME",
                what="Planner for the commands `?` and `p`.  [default: the preset's]")  # fmt: skip
@settings_option
def play(
    name: str,
    problem: Path | None,
    assignments: tuple[str, ...],
    seed: int,
    dt: float | None,
    settings: dict[str, dict[str, Any]],
    **disturbances: Any,
) -> None:
    """Step through the world of a domain file.

    Neither an environment nor Python is needed. Each step shows what changed, and by which line of
    the file. To act, enter the number or name of an action. `?` asks the planner, `p` lets the
    planner act, `u` undoes a step, and `h` shows all commands. On a terminal, an empty line repeats
    the last command.

    --failure, --slip and --noise add disturbances that the planner does not know, so you see
    whether its plans still work.

    `serp plan-and-learn --domain FILE` lets a learner practise in this world.
    """
    from serp.agent.registry import refuse_unknown_names
    from serp.authoring.play import Game
    from serp.tasks.file_world import WorldOptions, starting
    from serp.tasks.registry import find_domain_file
    from serp.ui.player import Player

    file = find_domain_file(name)
    domain, task = asked_domain(name, problem)
    resolved, dt = asked_settings(task, settings, dt)
    refuse_unknown_names(resolved, task)
    if not assignments and (domain.problem_syntax is None or not domain.problem_syntax.has_init):
        show(
            f"{domain.source.name}: no problem file gives an `:init`, so numbers begin at 0 and "
            "everything else is false. Change this with --state FLUENT=VALUE,..."
        )
    begun = parse_state(assignments, domain)
    game = Game(
        starting(domain, begun) if begun else domain, WorldOptions(**disturbances), dt=dt, seed=seed
    )
    player = Player(domain, task, dt, resolved, file is not None, game, begun)
    disturbed = "".join(f", {what} {size:g}" for what, size in disturbances.items() if size)
    show(f"the world of {game.domain.source.name}, control period {dt:g}{disturbed}")
    player.print_state()
    player.print_actions()
    player.play(by_hand=sys.stdin.isatty())
