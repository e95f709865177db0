"""A small world with a partly wrong file, made-up findings, checks of a repaired file."""

import dataclasses
import re
from pathlib import Path

import numpy as np

from serp.model.learned.adoption import ModelAdoption
from serp.model.learned.parameter_fit import parameter_dependencies
from serp.model.learned.regression_data import predicted_steps
from serp.model.learned.transitions import GOES_ON, OVER, TransitionMemory
from serp.runs.diagnosis.accuracy import forecast_with
from serp.runs.diagnosis.analysis import findings
from serp.runs.diagnosis.diagnosis import Recorded, make_diagnosis
from serp.runs.diagnosis.findings import (
    Findings,
    MissingEffect,
    ParameterFinding,
    RuleFinding,
    StochasticEffect,
)
from serp.runs.diagnosis.repair import repair
from tests.serp.model.learned.rolls import from_text
from tests.worlds import text

ROBOTS = text("robots")


def states_of(model, count, seed=0):
    """States and actions drawn at random."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(count, len(model.fluents)))
    for fluent in model.fluents:
        if not fluent.numeric:
            states[:, fluent.index] = rng.integers(2, size=count)
    return states, rng.integers(len(model.actions), size=count)


# Recorded runs


def taken(domain, experience, dt=1.0):
    """What a run has recorded."""
    model = domain.model.replace(dt=dt)
    return Recorded(
        run=Path("runs/seven"), domain=domain, files={}, model=model, experience=experience,
        adoption=ModelAdoption(adapts=False), env_steps=len(experience), learned_from="domain",
    )  # fmt: skip


def recorded(model, states, actions, next_states, rewards=None, over=None, domain=None):
    """What a run would have recorded of these steps, by default as the file rewards and ends."""
    experience = TransitionMemory(len(states), states.shape[1], len(model.actions))
    predicted = predicted_steps(model, states, actions)
    rewards = predicted[:, -2] if rewards is None else rewards
    over = predicted[:, -1] != 0.0 if over is None else over
    run = taken(domain or from_text(ROBOTS), experience, model.dt)
    for k, action in enumerate(actions.tolist()):
        ending = OVER if over[k] else GOES_ON
        experience.add(states[k], action, next_states[k], int(ending), rewards[k])
    return dataclasses.replace(run, model=model, env_steps=len(states))


def repaired_by(domain, experience, dt):
    """The domain repaired by what was observed."""
    run = taken(domain, experience, dt)
    diagnosis = make_diagnosis(run, findings(run.model, experience))
    return repair(domain, diagnosis.worthwhile)


# Findings


def parameter(model, position, estimate, *, error=0.02, cost=1):
    """The finding that a parameter has another value."""
    found = parameter_dependencies(model.ground)[position]
    value = found.parameter.value
    return ParameterFinding(
        found.parameter, found.schema, found.symbol, value, estimate, error, samples=412, cost=cost
    )


def found(*given):
    """Findings of any kinds."""

    def of(kind):
        return tuple(finding for finding in given if isinstance(finding, kind))

    return Findings(of(ParameterFinding), of(MissingEffect), of(StochasticEffect), of(RuleFinding))


def predictions_with(model, findings, states, actions):
    """The next states `[N, F]` to be expected with all findings taken into account."""
    return forecast_with(model, findings, states, actions).mean[:, :-2]


# Repaired files


def written(domain, repaired):
    """The repaired domain, with the problem of the old one."""
    problem = None if domain.problem_source is None else domain.problem_source.text
    return from_text(repaired.text, problem)


TOKEN = re.compile(r";[^\n]*|[()\s]|[^\s();]+")
CHANGED = re.compile(r"increase|decrease|assign|-?\d+(\.\d+)?")


def tokens(text):
    """Comments, words, brackets and white space; numbers, and words that turn them, are alike."""
    return ["#" if CHANGED.fullmatch(token) else token for token in TOKEN.findall(text)]


def kept(old, new):
    """Whether the old text is still there, in order, but for numbers and the words around them."""
    rest = iter(tokens(new))
    return all(token in rest for token in tokens(old))


def logic(domain):
    """Everything of a file that no repair may touch: conditions, events, rewards and flags."""
    found = []
    for schema in domain.syntax.schemas:
        if schema.kind.value == "event":
            found.append((schema.name, schema.place.text))
        elif schema.precondition is not None and not schema.name.endswith("-changes"):
            found.append((schema.name, schema.precondition.place.text))
    lines = domain.source.text.splitlines()
    return found + [
        ("", line.rstrip(" )")) for line in lines if "(unsafe)" in line or "(reward)" in line
    ]
