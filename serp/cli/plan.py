"""`serp plan`: one decision of the planner, as a table, JSON or a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from serp.cli.examples import ExampledCommand
from serp.cli.failures import say
from serp.cli.output import open_console, print_json
from serp.cli.tasks import asked_own_task, own_task_option
from serp.domain.source import listed
from serp.errors import SerpError

if TYPE_CHECKING:
    from serp.domain.loading import Domain
    from serp.domain.model import TransitionModel, Vector
    from serp.planning.replanner import MonitorReplanner
    from serp.task import Task


@click.command(
    "plan",
    cls=ExampledCommand,
    short_help="Show one decision of the planner, as a table or a picture.",
    examples=[
        "serp plan --domain cartpole",
        "serp plan --domain cartpole --observe --seed 3 --state pole-angle=0.2",
        "serp plan --domain my/world.pddl --problem my/world-problem.pddl --depth 4",
        "serp plan --domain cartpole --svg decision.svg",
    ],
)
@click.option("--domain", metavar="NAME|FILE", help="Installed task, or any domain file.")
@own_task_option
@click.option("--problem", type=click.Path(path_type=Path), metavar="FILE",
              help="Problem file.  [default: NAME-problem.pddl beside the domain]")  # fmt: skip
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Values of fluents; may be repeated.")  # fmt: skip
@click.option("--observe", is_flag=True,
              help="Take the state from the environment: the first one in which the actions differ "
                   "in what they promise; with --state, the one after a reset.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the reset.")  # fmt: skip
@click.option("--depth", type=click.IntRange(min=1), metavar="N",
              help="Actions to look ahead.  [default: the task's, else 5]")  # fmt: skip
@click.option("--discount", type=click.FloatRange(0, 1, min_open=True), metavar="X",
              help="Weight of a reward one control period later.")  # fmt: skip
@click.option("--repeat", type=click.IntRange(min=1), metavar="N",
              help="Control periods that an action is repeated for in the lookahead.")  # fmt: skip
@click.option("--dt", type=click.FloatRange(min=0, min_open=True), metavar="X",
              help="Control period.  [default: the task's, else 1]")  # fmt: skip
@click.option("--time-budget", type=click.FloatRange(min=0, min_open=True), default=10.0,
              show_default=True, metavar="S", help="Most seconds to look ahead.")  # fmt: skip
@click.option("--svg", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE.svg",
              help="Draw the planning graph there.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.pass_context
def command(
    ctx: click.Context,
    domain: str | None,
    problem: Path | None,
    assignments: tuple[str, ...],
    observe: bool,
    seed: int,
    depth: int | None,
    discount: float | None,
    repeat: int | None,
    dt: float | None,
    time_budget: float,
    svg: Path | None,
    as_json: bool,
) -> None:
    """Show what the planner decides in one state, and why.

    The state is what --state says, the rest of it from the problem file or (with --observe) from
    the task's environment. With neither, the problem's initial state is taken, or else one that is
    observed. While all actions promise the same there, the planner's is carried out, and the next
    state is looked at.
    """
    if svg is not None and svg.suffix.lower() != ".svg":
        raise click.BadParameter("the picture is an SVG; name a file that ends in .svg", ctx,
                                 param_hint="--svg")  # fmt: skip
    loaded = _load(ctx, domain, problem)
    period = dt or (loaded.task.dt if loaded.task else 1.0)
    model = loaded.domain.model.replace(dt=period)
    planner = _planner(
        loaded, model, depth=depth, discount=discount, repeat=repeat, time_budget=time_budget
    )
    state, origin = _state(loaded, planner, assignments, observe=observe, seed=seed)
    plan = planner.plan(state)

    from serp.cli.decision import describe, print_plan
    from serp.cli.rewards import learned_from

    if as_json:
        print_json(describe(loaded.domain.name, origin, planner, state, plan))
    else:
        print_plan(open_console(), loaded.domain.name, origin, planner, state, plan)
        if loaded.task is not None and loaded.domain.model.rewarding:
            open_console().print(learned_from(loaded.domain, loaded.task))
    if svg is not None:
        from serp.drawing import draw_plan, svg_bytes
        from serp.runs.durable import write_durably

        figure = draw_plan(plan, planner, title=f"{loaded.domain.name}, {origin}")
        write_durably(svg, svg_bytes(figure))
        say(f"The planning graph is drawn in {svg}")


class _Loaded(NamedTuple):
    """A domain, and the installed task that it belongs to, if any."""

    domain: Domain
    task: Task | None


def _load(ctx: click.Context, name: str | None, problem: Path | None) -> _Loaded:
    from serp.domain.loading import Domain, load_domain
    from serp.registry import find_domain_file, load_task, task_of

    task = asked_own_task()
    if name is None and task is None:
        raise click.UsageError("give --domain (`serp list` names the tasks), or --task", ctx)
    path = find_domain_file(name) if name is not None else None
    if path is not None:
        domain = load_domain(path, problem)
        return _Loaded(domain, task_of(domain, path) if task is None else task)
    if task is None:
        task = load_task(str(name))
    if problem is None:
        return _Loaded(task.load(), task)
    file = task.domain.source.name if isinstance(task.domain, Domain) else task.domain
    return _Loaded(load_domain(file, problem), task)


def _state(
    loaded: _Loaded,
    planner: MonitorReplanner,
    assignments: tuple[str, ...],
    *,
    observe: bool,
    seed: int,
) -> tuple[Vector, str]:
    """Return the state to plan from, and a few words on where it comes from."""
    from serp.cli.values import parse_state

    model = planner.model
    names = {fluent.name: fluent.numeric for fluent in model.fluents}
    given = parse_state(assignments, names, model.ground.static)
    missing = [name for name in names if name not in given]
    # What --state changes is the state after the reset, whatever there is to choose.
    choosing = None if given else planner
    if observe:
        base, origin = _observed(loaded, choosing, seed)
    elif not missing:
        return model.state(given), "in the given state" if given else "in its only state"
    elif model.initial_state is not None:
        base, origin = model.values(model.initial_state), "in the initial state of its problem"
    elif given:
        raise SerpError(f"--state leaves out {listed(missing)}; {_how_to_complete(loaded)}")
    elif loaded.task is not None:
        base, origin = _observed(loaded, choosing, seed)
    else:
        raise SerpError(
            f"{loaded.domain.source.name}: which state? Give one with --state, a value for each "
            f"of {listed(missing)}; or give a problem file with an :init"
        )
    if given:
        origin += ", changed by --state"
    return model.state({**base, **given}), origin


def _how_to_complete(loaded: _Loaded) -> str:
    if loaded.task is not None:
        return "give these too, or take them from the environment with --observe"
    return "give these too, or a problem file with an :init"


def _observed(
    loaded: _Loaded, planner: MonitorReplanner | None, seed: int
) -> tuple[dict[str, float | bool], str]:
    """Return a state of the task's environment: after a reset, or where a planner has a choice."""
    import dataclasses

    from serp.cli.observing import observed, observed_choice

    if loaded.task is None:
        raise SerpError(
            f"--observe: no task is installed for domain `{loaded.domain.name}`, so there is no "
            "environment to observe; give the state with --state"
        )
    task = dataclasses.replace(loaded.task, domain=loaded.domain, problem=None)
    if planner is None:
        state, origin = observed(task, seed)
    else:
        state, origin = observed_choice(task, planner, seed)
    return loaded.domain.model.values(state), origin


def _planner(
    loaded: _Loaded,
    model: TransitionModel,
    *,
    depth: int | None,
    discount: float | None,
    repeat: int | None,
    time_budget: float,
) -> MonitorReplanner:
    from serp.planning.replanner import MonitorReplanner
    from serp.planning.settings import PlannerSettings
    from serp.settings import resolve

    usual = resolve("default", loaded.task.settings).planner if loaded.task else PlannerSettings()
    return MonitorReplanner(
        model,
        depth=depth or usual.depth,
        discount=discount or usual.discount,
        repeat=repeat or usual.repeat,
        max_nodes=usual.max_nodes,
        time_budget=time_budget,
    )
