"""`serp plan`: one decision of the planner, as a table, JSON or a picture."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from serp.errors import SerpError, SettingsError
from serp.ui.asked import MakePlanner, asked_domain, asked_state, open_run
from serp.ui.options import (
    OutputFile,
    own_task_option,
    refuse_given,
    settings_option,
)
from serp.ui.output import examples, open_console, print_json
from serp.ui.root import say

if TYPE_CHECKING:
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.model.domain import Domain
    from serp.runs.run import Run
    from serp.settings import Changes
    from serp.tasks.task import Task


@click.command(
    "plan",
    epilog=examples(
        "serp plan --domain cartpole",
        "serp plan --domain cartpole --observe --seed 3 --state pole-angle=0.2",
        "serp plan --domain my/world.pddl --set planner.discount=0.9 --svg decision.svg",
        "serp plan runs/seven --seed 3",
    ),
)
@click.argument("run", type=click.Path(path_type=Path), required=False)
@click.option("--domain", "name", metavar="NAME|FILE",
              help="Installed task, or any domain file.")  # fmt: skip
@own_task_option
@click.option("--problem", type=click.Path(path_type=Path), metavar="FILE",
              help="Problem file.  [default: NAME-problem.pddl beside the domain]")  # fmt: skip
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Values of fluents; may be repeated.")  # fmt: skip
@click.option("--observe", is_flag=True,
              help="Take the state from the environment: the first one in which the planner has "
                   "a choice; with --state, the one after a reset.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the reset.")  # fmt: skip
@click.option(
    "--planner",
    "planner_name",
    metavar="NAME",
    help="Who plans.  [default: the planner of a training]",
)
@click.option("--depth", type=click.IntRange(min=1), metavar="N",
              help="Actions to look ahead, where the planner does not see to the end.  "
                   "[default: the task's, else 5]")  # fmt: skip
@click.option("--dt", type=click.FloatRange(min=0, min_open=True), metavar="X",
              help="Control period.  [default: the task's, else 1]")  # fmt: skip
@settings_option
@click.option("--svg", type=OutputFile(".svg"), metavar="FILE.svg",
              help="Draw the planning graph there, that of the lookahead.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
def command(
    run: Path | None,
    name: str | None,
    problem: Path | None,
    assignments: tuple[str, ...],
    observe: bool,
    seed: int,
    svg: Path | None,
    as_json: bool,
    **planning: Any,
) -> None:
    """Show what the planner decides in one state, and why.

    The state is what --state says, the rest of it from the problem file or (with --observe) from
    the task's environment. With neither, the problem's initial state is taken, or else one that is
    observed.

    The planner is the one that a training begins with, with the settings of the task. The picture
    is one of the lookahead, and says so where the planner sees something else.

    With RUN, the folder of a training, the decision is that of its planner, with the model that it
    plans with, whatever that has learned.
    """
    from serp.agent.sentences import lines_of_changes
    from serp.ui.account import describe, print_plan

    loaded = None if run is None else _opened(run)
    if loaded is None:
        domain, task = asked_domain(name, problem)
        make_planner = _planning(task, **planning)
    else:
        domain, task, make_planner = loaded.agent.task.domain, loaded.task, _planner_of(loaded)
    domain, state, origin = asked_state(
        domain, task, make_planner, assignments, observe=observe, seed=seed
    )
    planner = make_planner(domain)
    plan = planner.plan(state)
    account = planner.explain(state, plan)
    changes = None
    if loaded is not None and len(recording := loaded.recording()):
        changes = planner.other_choices(state, recording.ranges, recording.whole)
    title = f"{domain.name}, {origin}"
    if as_json:
        about = {"domain": domain.name, "state_from": origin, **describe(planner, account, plan)}
        print_json({**about, "counterfactuals": None if changes is None else asdict(changes)})
    else:
        console = open_console()
        print_plan(console, title, planner, account, plan)
        if changes is not None:
            console.print("")
            for line in [*lines_of_changes(changes), changes.searched]:
                console.print(line)
        if loaded is not None:
            console.print(f"The model of {run} is {loaded.agent.adaptation.adoption}.")
    if svg is not None:
        from serp._util.files import write_durably
        from serp.ui.pictures.plan_picture import plan_picture

        drawn, what = plan, "The planning graph"
        if not planner.decided_by_graph(plan):  # what else it sees cannot be drawn
            drawn, what = planner.lookahead.plan(state), "What the lookahead alone would choose"
            title += ": the lookahead alone"
        write_durably(svg, plan_picture(drawn, planner.lookahead, title=title))
        say(f"{what} is drawn in {svg}")


def _opened(folder: Path) -> Run:
    """Open the run that is asked for."""
    own = ("name", "problem", "planner_name", "depth", "dt", "settings")
    refuse_given(own, "cannot be given beside a run, which has its own")
    if not folder.is_dir():
        raise click.UsageError(
            f"there is no run {folder}; a task or a domain file is given as --domain {folder}"
        )
    return open_run(folder)


def _planner_of(run: Run) -> MakePlanner:
    """Return a function that returns the planner of a run, with the model that it plans with."""
    from serp.agent.chosen_planner import ChosenPlanner

    agent = run.agent
    planner, model, settings = agent.arbiter.planner, agent.arbiter.model, agent.settings.planner

    def make_planner(domain: Domain) -> ChosenPlanner:
        if domain.model.fluents != model.fluents:
            raise SerpError("--state gives a value to what the problem file of the run fixes")
        name = "The planner of the run"
        return ChosenPlanner(planner, model, settings, name, agent.undisturbed)

    return make_planner


def _planning(
    task: Task | None,
    settings: Changes,
    dt: float | None,
    planner_name: str | None,
    depth: int | None,
) -> MakePlanner:
    """Return a function that makes the planner of a domain, as task, settings and options say."""
    of_decision = ("name", "depth", "discount", "max_nodes", "accepted_risk")
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.settings import resolve

    resolved = resolve("default", None if task is None else task.settings, settings)
    for section, values in settings.items():
        for name in values:
            if section != "planner" or name not in of_decision:
                known = ", ".join(f"planner.{used}" for used in of_decision)
                raise SettingsError(f"--set {section}.{name}: one decision uses only {known}")
    options = {"name": planner_name, "depth": depth}
    chosen = resolved.planner.replace(**{k: v for k, v in options.items() if v is not None})
    period = dt or (task.dt if task else 1.0)

    def make_planner(domain: Domain) -> ChosenPlanner:
        model = domain.model.replace(dt=period)
        return ChosenPlanner.of_settings(model, chosen, task)

    return make_planner
