"""`serp plan`: one decision of the planner, as a table, JSON or a picture."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.did_you_mean import listed
from serp.errors import SerpError
from serp.ui.options import (
    OutputFile,
    asked_domain,
    asked_settings,
    command,
    dt_option,
    json_option,
    open_run,
    own_task_name,
    own_task_option,
    parse_state,
    problem_option,
    refuse_given,
    seed_option,
    setting_option,
    settings_option,
    with_domain,
)
from serp.ui.output import print_json, show
from serp.ui.root import say, working

if TYPE_CHECKING:
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.model.domain import Domain
    from serp.model.transition_model import Vector
    from serp.runs.run import Run
    from serp.settings import Changes
    from serp.tasks.task import Task


@command(
    "serp plan --domain cartpole",
    "serp plan --domain cartpole --observe --seed 3 --state pole-angle=0.2",
    "serp plan --domain my/world.pddl --set planner.discount=0.9 --svg decision.svg",
    "serp plan runs/seven --seed 3",
)
@click.argument("run", type=click.Path(path_type=Path), required=False)
@click.option("--domain", "name", metavar="NAME|FILE",
              help="An installed task or any domain file.")  # fmt: skip
@own_task_option
@problem_option
@click.option("--state", "assignments", multiple=True, metavar="FLUENT=VALUE,...",
              help="Values of fluents; may be repeated.")  # fmt: skip
@click.option("--observe", is_flag=True,
              help="Take the state from the environment, after a reset.")  # fmt: skip
@seed_option("Seed of the reset.")
@setting_option("--planner", "planner.name", metavar="NAME",
                what="Planner to use.  [default: the planner that training uses]")  # fmt: skip
@setting_option("--depth", "planner.depth", metavar="N",
                what="Number of actions to look ahead, if the planner does not see as far as the "
                     "end of the task.  [default: the task's, else 5]")  # fmt: skip
@dt_option
@settings_option
@click.option("--svg", type=OutputFile(".svg"), metavar="FILE.svg",
              help="File for a picture of the lookahead's planning graph.")  # fmt: skip
@json_option
def plan(
    run: Path | None,
    name: str | None,
    problem: Path | None,
    assignments: tuple[str, ...],
    observe: bool,
    seed: int,
    svg: Path | None,
    as_json: bool,
    settings: Changes,
    dt: float | None,
) -> None:
    """Show what the planner decides in one state, and why.

    --state sets fluents. The other fluents come from the problem file or, with --observe, from the
    task's environment. If neither option is given, the state is the problem's initial state, or
    else an observed state.

    The planner and its settings are those of a new run of the task. The picture shows the
    lookahead; its title says so if the planner uses another method.

    If RUN, the folder of a run, is given, the run's planner and learned model are used.
    """
    from serp.agent.chosen_planner import ChosenPlanner
    from serp.agent.sentences import lines_of_changes
    from serp.ui.account import describe, print_plan

    with working(f"planning in {run or name or own_task_name()}"):
        loaded = None if run is None else _opened(run)
        if loaded is None:
            domain, task = asked_domain(name, problem)
        else:
            domain, task = loaded.agent.task.domain, loaded.task
        domain, state, origin = _asked_state(domain, task, assignments, observe=observe, seed=seed)
        if loaded is None:
            chosen, period = asked_settings(task, settings, dt)
            model = domain.model.replace(dt=period)
            planner = ChosenPlanner.of_settings(model, chosen.planner, task)
        else:
            planner = _planner_of(loaded, domain)
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
        print_plan(title, planner, account, plan)
        if changes is not None:
            show()
            for line in [*lines_of_changes(changes), changes.searched]:
                show(line)
        if loaded is not None:
            show(f"The model of {run} is {loaded.agent.adaptation.adoption}.")
    if svg is not None:
        from serp._util.files import write_durably
        from serp.ui.pictures.plan_picture import plan_picture

        drawn, what = plan, "The planning graph"
        if not planner.decided_by_graph(plan):  # what else it sees cannot be drawn
            drawn, what = planner.lookahead.plan(state), "What the lookahead alone would choose"
            title += ": the lookahead alone"
        write_durably(svg, plan_picture(drawn, planner.lookahead, title=title))
        say(f"{what} is drawn in {svg}")


def _asked_state(
    domain: Domain, task: Task | None, assignments: Iterable[str], *, observe: bool, seed: int
) -> tuple[Domain, Vector, str]:
    """Return the domain, grounded for the state to plan from; this state `[F]`; its origin.

    The state is what `assignments` say, the rest of it from the problem or, with `observe` or where
    nothing else is known, from the environment of the task after a reset with `seed`.
    """
    given = parse_state(assignments, domain)
    complete = all(fluent.name in given for fluent in domain.model.fluents)
    problem, grounded = domain.problem_syntax, domain
    if task is not None:
        grounded = domain.observed(given)
    elif given and problem is not None and problem.has_init:
        # What can be reached is reached from the given state.
        from serp.tasks.file_world import starting

        grounded = starting(domain, given)
    initial = grounded.model.initial_state
    if observe or (task is not None and not given and not complete and initial is None):
        if task is None:
            raise SerpError(
                f"--observe: no task is installed for domain `{domain.name}`, so there is no "
                "environment to observe; give the state with --state"
            )
        with with_domain(task, domain).bind() as bound:
            # The grounding says what of :init is observed.
            grounded = domain if problem is None else bound.domain
            raw, info = bound.reset(seed)
            base = grounded.model.values(bound.ground(raw, info, bound.env))
        origin = f"observed after a reset with seed {seed}"
    elif seed and task is not None:
        raise SerpError("--seed is the seed of the environment's reset; give --observe, too")
    elif complete or initial is not None:
        base = {} if initial is None else grounded.model.values(initial)
        origin = "in the initial state of its problem"
        if complete:
            origin = "in the given state"
    else:
        missing = [fluent.name for fluent in grounded.model.fluents if fluent.name not in given]
        other = "a problem file with an :init" if task is None else "--observe"
        raise SerpError(
            f"{domain.source.name}: the state is incomplete: --state gives no value for "
            f"{listed(missing)}; give these, too, or {other}"
        )
    if given and not complete:
        origin += ", changed by --state"
    fluents = {fluent.name for fluent in grounded.model.fluents}
    for name in given.keys() - fluents:  # in a closed world it is part of the :init by now
        if grounded.supplied is not None or observe:
            raise SerpError(f"--state: `{name}` is fixed by the problem file; change it there")
        del given[name]
    return grounded, grounded.model.state({**base, **given}), origin


def _opened(folder: Path) -> Run:
    """Open the run that is asked for."""
    own = ("name", "problem", "planner", "depth", "dt", "settings")
    refuse_given(own, "cannot be combined with a run, because the run has its own")
    if not folder.is_dir():
        raise click.UsageError(
            f"there is no run {folder}; for a task or a domain file, write --domain {folder}"
        )
    return open_run(folder)


def _planner_of(run: Run, domain: Domain) -> ChosenPlanner:
    """Return the planner of a run, with the model that it plans with."""
    from serp.agent.chosen_planner import ChosenPlanner

    agent = run.agent
    model = agent.arbiter.model
    if domain.model.fluents != model.fluents:
        raise SerpError("--state sets a value that is fixed by the problem file of the run")
    settings, name = agent.settings.planner, "The planner of the run"
    return ChosenPlanner(agent.arbiter.planner, model, settings, name, agent.undisturbed)
