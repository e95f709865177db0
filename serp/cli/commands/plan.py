"""`serp plan`: one decision of the planner, as a table, JSON or a picture."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from serp._util.text import listed
from serp.cli.examples import ExampledCommand
from serp.cli.failures import say
from serp.cli.output import open_console, print_json
from serp.cli.tasks import asked_own_task, domain_of, own_task_option
from serp.errors import SerpError

if TYPE_CHECKING:
    from serp.model.loading import Domain
    from serp.model.transition_model import TransitionModel, Vector
    from serp.planning.replanner import MonitorReplanner
    from serp.tasks.task import Task


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
@click.option("--max-ground-schemas", type=click.IntRange(min=1), metavar="N",
              help="Most ground actions, processes and events.  [default: 50000]")  # fmt: skip
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
    max_ground_schemas: int | None,
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
    loaded = _load(ctx, domain, problem, max_ground_schemas)
    period = dt or (loaded.task.dt if loaded.task else 1.0)

    def planner_of(domain: Domain) -> MonitorReplanner:
        return _planner(
            loaded,
            domain.model.replace(dt=period),
            depth=depth,
            discount=discount,
            repeat=repeat,
            time_budget=time_budget,
        )

    loaded, state, origin = _state(loaded, planner_of, assignments, observe=observe, seed=seed)
    planner = planner_of(loaded.domain)
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
        from serp._util.extras import needs_extra
        from serp._util.files import write_durably

        with needs_extra("plots", "a picture of the planning graph"):
            from serp.viz.plan_drawing import draw_plan, svg_bytes

        figure = draw_plan(plan, planner, title=f"{loaded.domain.name}, {origin}")
        write_durably(svg, svg_bytes(figure))
        say(f"The planning graph is drawn in {svg}")


class _Loaded(NamedTuple):
    """A domain, and the installed task that it belongs to, if any."""

    domain: Domain
    task: Task | None


def _load(
    ctx: click.Context, name: str | None, problem: Path | None, max_ground_schemas: int | None
) -> _Loaded:
    import dataclasses

    from serp.model.loading import load_domain
    from serp.tasks.registry import find_domain_file, load_task, task_of

    task = asked_own_task()
    if name is None and task is None:
        raise click.UsageError("give --domain (`serp list` names the tasks), or --task", ctx)
    path = find_domain_file(name) if name is not None else None
    if path is not None:
        domain = load_domain(path, problem, max_ground_schemas=max_ground_schemas)
        if task is None:
            task = task_of(domain, path)
        else:
            task = dataclasses.replace(task, domain=domain, problem=None)
        return _Loaded(domain if task is None else task.load(), task)
    if task is None:
        task = load_task(str(name))
    return _Loaded(domain_of(task, problem, max_ground_schemas), task)


class _GroundNames(Mapping[str, bool]):
    """Every ground predicate and function of a domain → whether it is numeric.

    Those that are listed are the ones that its model names.
    """

    def __init__(self, domain: Domain) -> None:
        self._domain = domain

    def __getitem__(self, name: str) -> bool:
        declaration = self._domain.declared(name)
        if declaration is None:
            raise KeyError(name)
        return declaration.numeric

    def __iter__(self) -> Iterator[str]:
        model = self._domain.model
        yield from (fluent.name for fluent in model.fluents)
        yield from model.ground.static

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _state(
    loaded: _Loaded,
    planner_of: Callable[[Domain], MonitorReplanner],
    assignments: tuple[str, ...],
    *,
    observe: bool,
    seed: int,
) -> tuple[_Loaded, Vector, str]:
    """Return the state to plan from, a few words on where it comes from, and its domain."""
    from serp.cli.values import parse_state

    domain, given = loaded.domain, parse_state(assignments, _GroundNames(loaded.domain))
    complete = all(fluent.name in given for fluent in domain.model.fluents)
    problem = domain.problem_syntax
    if observe:
        pass
    elif loaded.task is None and problem is not None and problem.has_init:
        # What can be reached is reached from the given state.
        domain = domain.starting(given) if given else domain
    elif loaded.task is not None:
        domain = domain.observed(given)
    model = domain.model
    missing = [fluent.name for fluent in model.fluents if fluent.name not in given]
    # What --state changes is the state after the reset, whatever there is to choose.
    choosing = None if given else planner_of
    if observe:
        domain, base, origin = _observed(loaded, choosing, seed)
    elif complete:
        base = {} if model.initial_state is None else model.values(model.initial_state)
        origin = "in the given state" if given else "in its only state"
    elif model.initial_state is not None:
        base, origin = model.values(model.initial_state), "in the initial state of its problem"
    elif given:
        raise SerpError(f"--state leaves out {listed(missing)}; {_how_to_complete(loaded)}")
    elif loaded.task is not None:
        domain, base, origin = _observed(loaded, choosing, seed)
    else:
        raise SerpError(
            f"{domain.source.name}: which state? Give one with --state, a value for each of "
            f"{listed(missing)}; or give a problem file with an :init"
        )
    if given and not complete:
        origin += ", changed by --state"
    fluents = {fluent.name for fluent in domain.model.fluents}
    for name in given.keys() - fluents:  # in a closed world it is part of the :init by now
        if domain.supplied is not None or observe:
            raise SerpError(f"--state: `{name}` is fixed by the problem file; change it there")
        del given[name]
    return loaded._replace(domain=domain), domain.model.state({**base, **given}), origin


def _how_to_complete(loaded: _Loaded) -> str:
    if loaded.task is not None:
        return "give these too, or take them from the environment with --observe"
    return "give these too, or a problem file with an :init"


def _observed(
    loaded: _Loaded, planner_of: Callable[[Domain], MonitorReplanner] | None, seed: int
) -> tuple[Domain, dict[str, float | bool], str]:
    """Return the task's domain and a state: after a reset, or where a planner has a choice."""
    import dataclasses

    from serp.cli.observing import observed, observed_choice

    if loaded.task is None:
        raise SerpError(
            f"--observe: no task is installed for domain `{loaded.domain.name}`, so there is no "
            "environment to observe; give the state with --state"
        )
    task = dataclasses.replace(loaded.task, domain=loaded.domain, problem=None)
    domain = loaded.domain
    if domain.problem_syntax is not None:  # what of its :init is observed, the grounding tells
        with task.bind() as bound:
            domain = bound.domain
    if planner_of is None:
        state, origin = observed(task, seed)
    else:
        state, origin = observed_choice(task, planner_of(domain), seed)
    return domain, domain.model.values(state), origin


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
    from serp.settings import PlannerSettings, resolve

    usual = resolve("default", loaded.task.settings).planner if loaded.task else PlannerSettings()
    return MonitorReplanner(
        model,
        depth=depth or usual.depth,
        discount=discount or usual.discount,
        repeat=repeat or usual.repeat,
        max_nodes=usual.max_nodes,
        time_budget=time_budget,
    )
