"""A hierarchical task: the actions of a soccer defender are runs on two parts of the task."""

import sys
from pathlib import Path

import serp
from serp_envs import MacroActions, SubTask

HERE = Path(__file__).parent
SOCCER = serp.load_task("soccer")
FLUENTS = [fluent.name for fluent in SOCCER.load().model.fluents]
REACH, LOST = 0.27, 0.5  # distances to the ball, m
ONLY_KNOWN = {"*": {"arbiter": {"unmodelled": "veto"}}}  # no charge at the opponent


def grounding(*names):
    """Return the grounding of the soccer task for a file with fewer fluents."""

    def ground(seen):
        values = zip(FLUENTS, SOCCER.ground(seen), strict=True)
        return {fluent: value for fluent, value in values if fluent.split()[0] in names}

    return ground


def to_ball(seen):
    """Return the distance to the ball."""
    return SOCCER.ground(seen)[FLUENTS.index("robot-to-ball")]


def approach() -> serp.Task:
    """Return the first part, until the ball is in reach."""
    return serp.Task(
        make_env=lambda **how: SubTask(
            SOCCER.make_env(**how), until=lambda seen: to_ball(seen) < REACH
        ),
        domain=HERE / "approach.pddl",
        ground=grounding(
            "lined", "in-range", "robot-to-ball", "opponent-to-ball", "off-line", "goal-open"
        ),
        actions={"cover-goal": 0, "frontal-contrast": 3},
        dt=SOCCER.dt,
        settings=ONLY_KNOWN,
        reward="domain",
    )


def contest(begin) -> serp.Task:
    """Return the second part, from where the option `begin` ends until the ball is lost."""
    return serp.Task(
        make_env=lambda **how: SubTask(
            SOCCER.make_env(**how), until=lambda seen: to_ball(seen) > LOST, begin=begin
        ),
        domain=HERE / "contest.pddl",
        ground=grounding(
            "free", "lined", "in-range", "pushed", "robot-to-ball", "opponent-to-ball", "goal-open"
        ),
        actions={name: k for name, k in SOCCER.actions.items() if name != "charge-opponent"},
        dt=SOCCER.dt,
        settings=ONLY_KNOWN,
        reward="environment",
    )


def defence(options) -> serp.Task:
    """Return the whole task, whose actions are the parts."""
    return serp.Task(
        make_env=lambda **how: MacroActions(SOCCER.make_env(**how), options),
        domain=HERE / "defence.pddl",
        ground=grounding("free", "pushed", "robot-to-ball"),
        actions={name: number for number, name in enumerate(options)},
        reward="environment",
    )


if __name__ == "__main__":
    steps = [int(word) for word in sys.argv[1:]] or [1000, 4000, 500]
    first = serp.plan_and_learn(approach(), env_steps=steps[0]).option(steps=20)
    second = serp.plan_and_learn(contest(first), env_steps=steps[1]).option(steps=20)
    options = {"approach": first, "contest": second}
    run = serp.plan_and_learn(defence(options), env_steps=steps[2])
    print(run.evaluate("serp", episodes=300).mean)
