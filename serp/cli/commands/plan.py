"""`serp plan`: one decision of the planner, as a table, JSON or a picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp.cli.asked import asked_domain, asked_own_task
from serp.cli.failures import say
from serp.cli.options import as_record, max_ground_schemas_option, own_task_option
from serp.cli.output import ExampledCommand, open_console, print_json
from serp.cli.state import AskedDomain, asked_state

if TYPE_CHECKING:
    from serp.model.loading import Domain
    from serp.model.transition_model import TransitionModel
    from serp.planning.replanner import MonitorReplanner
    from serp.tasks.task import Task


@dataclass(frozen=True)
class PlanOptions:
    """What `serp plan` is given; the help of the command says what each is."""

    domain: str | None
    problem: Path | None
    max_ground_schemas: int | None
    assignments: tuple[str, ...]
    observe: bool
    seed: int
    depth: int | None
    discount: float | None
    repeat: int | None
    dt: float | None
    time_budget: float
    svg: Path | None
    as_json: bool


@click.command(
    "plan",
    cls=ExampledCommand,
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
@max_ground_schemas_option
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Values of fluents; may be repeated.")  # fmt: skip
@click.option("--observe", is_flag=True,
              help="Take the state from the environment: the first one in which the actions have "
                   "different best returns; with --state, the one after a reset.")  # fmt: skip
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
@as_record(PlanOptions)
def command(ctx: click.Context, given: PlanOptions) -> None:
    """Show what the planner decides in one state, and why.

    The state is what --state says, the rest of it from the problem file or (with --observe) from
    the task's environment. With neither, the problem's initial state is taken, or else one that is
    observed. While the planner is indifferent there, its action is executed, and the next state is
    tried.
    """
    if given.svg is not None and given.svg.suffix.lower() != ".svg":
        raise click.BadParameter("the picture is an SVG; name a file that ends in .svg", ctx,
                                 param_hint="--svg")  # fmt: skip
    own = asked_own_task()
    if given.domain is None and own is None:
        raise click.UsageError("give --domain (`serp list` names the tasks), or --task", ctx)
    from serp.tasks.registry import find_domain_file

    file = find_domain_file(given.domain) if given.domain is not None else None
    domain, task = asked_domain(
        str(given.domain), file, given.problem, given.max_ground_schemas, own
    )
    period = given.dt or (task.dt if task else 1.0)

    def planner_of(domain: Domain) -> MonitorReplanner:
        return _planner(domain.model.replace(dt=period), task, given)

    domain, state, origin = asked_state(
        AskedDomain(domain, task), planner_of, given.assignments,
        observe=given.observe, seed=given.seed,
    )  # fmt: skip
    planner = planner_of(domain)
    plan = planner.plan(state)

    from serp.cli.decision import describe, print_plan
    from serp.cli.output import learned_from

    if given.as_json:
        print_json(describe(domain.name, origin, planner, state, plan))
    else:
        print_plan(open_console(), domain.name, origin, planner, state, plan)
        if task is not None and domain.model.rewarding:
            open_console().print(learned_from(domain, task))
    if given.svg is not None:
        from serp._util.extras import needs_extra
        from serp._util.files import write_durably

        with needs_extra("plots", "a picture of the planning graph"):
            from serp.viz.plan_drawing import draw_plan, svg_bytes

        figure = draw_plan(plan, planner, title=f"{domain.name}, {origin}")
        write_durably(given.svg, svg_bytes(figure))
        say(f"The planning graph is drawn in {given.svg}")


def _planner(model: TransitionModel, task: Task | None, given: PlanOptions) -> MonitorReplanner:
    from serp.planning.replanner import MonitorReplanner
    from serp.settings import PlannerSettings, resolve

    usual = resolve("default", task.settings).planner if task else PlannerSettings()
    return MonitorReplanner(
        model,
        depth=given.depth or usual.depth,
        discount=given.discount or usual.discount,
        repeat=given.repeat or usual.repeat,
        max_nodes=usual.max_nodes,
        time_budget=given.time_budget,
    )
