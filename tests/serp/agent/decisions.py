"""Decisions in random worlds, and what the model itself predicts where they are made."""

import math
from dataclasses import dataclass

import numpy as np

from serp._util.numbers import best_of
from serp.agent.arbiter import Arbiter
from serp.agent.protocols import LearnerProposer
from serp.agent.registry import find_strategy
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE, risk_of
from serp.planning.forecast import SAFE
from serp.planning.lookahead import Lookahead
from serp.settings import ArbiterSettings, GuideSettings, PlannerSettings, Settings
from serp.tasks.action_map import ActionMap
from tests.serp.planning.worlds import WORLDS, load, risky_world, world
from tests.worlds import text

GLIDER = load(text("glider"))
"""What is unsafe here is so some steps ahead: speed is lost slowly."""

WRITTEN = (*map(world, range(WORLDS)), GLIDER)
RISKY = tuple(map(risky_world, range(WORLDS)))
MODELS = (*WRITTEN, *RISKY)
"""As the file has them, and adapted, with risks of all sizes."""


class Wild:
    """A learner whose values are random, infinite and NaN among them; it explores half the time."""

    def __init__(self, seed, actions):
        self.random = np.random.default_rng(seed)
        self.actions = actions

    def propose(self, x, explorable):
        if self.random.random() < 0.5:
            return self.propose_greedily(x)
        allowed = np.arange(self.actions)
        if explorable is not None and explorable.any():
            allowed = np.flatnonzero(explorable)
        return Proposal(int(self.random.choice(allowed)), True)

    def propose_greedily(self, x):
        return Proposal(best_of(self.values(x)[0]), False)

    def values(self, x):
        wild = self.random.choice([math.inf, -math.inf, math.nan, -1e39], self.actions)
        values = np.where(
            self.random.random(self.actions) < 0.2, wild, self.random.normal(size=self.actions)
        )
        return values.astype(np.float32)[None]


@dataclass(frozen=True)
class View:
    """What a model predicts of every environment action, read off the model itself.

    `kind` is unknown, not applicable, unsafe (by the file as written), undefined, certain or risky
    (a risk of 1, or less, that is not accepted) or safe.
    """

    kind: list[str]
    reward: list[float]
    steps: list[int]
    applicable: list[bool]

    @classmethod
    def of(cls, arbiter, state):
        view, model, actions = cls([], [], [], []), arbiter.model, arbiter.actions
        written = getattr(model, "written", model)
        accepted = arbiter.planner.settings.accepted_risk
        safe_steps = arbiter.planner.forecast(state).safe_steps.tolist()
        predicted = [model.transition(state.tolist(), k) for k in range(len(model.actions))]
        flags = [flag for _, flag in predicted]
        flagged = [
            written.transition(state.tolist(), k)[1] & UNSAFE for k in range(len(model.actions))
        ]
        for action in range(actions.size):
            group = [k for k, e in enumerate(actions.environment_action) if e == action]
            # Which of them the environment would carry out is not known, so the worst counts.
            possible = [k for k in group if flags[k]]
            applicable = [k for k in group if flags[k] & APPLICABLE]
            unsafe = [k for k in possible if flagged[k]]
            undefined = [k for k in possible if flags[k] & UNDEFINED]
            worst = unsafe or undefined or applicable
            known = bool(worst) and all(flags[k] & APPLICABLE for k in worst)
            risk = max((risk_of(flags[k]) for k in possible), default=0.0)
            view.kind.append(
                "unknown" if not group
                else "not applicable" if not possible
                else "unsafe" if unsafe
                else "undefined" if undefined
                else "safe" if risk <= accepted
                else "risky" if risk < 1.0
                else "certain"
            )  # fmt: skip
            view.applicable.append(known)
            view.reward.append(min(predicted[k][0][-1] for k in applicable) if known else math.nan)
            view.steps.append(min(safe_steps[k] for k in applicable) if known else -1)
        return view

    def admissible(self, settings):
        """Which actions pass every veto, by the words of `ArbiterSettings`."""
        somewhere_safe = any(
            steps == SAFE for kind, steps in zip(self.kind, self.steps, strict=True)
            if kind != "unknown"
        )  # fmt: skip
        allowed = []
        for kind, reward, steps in zip(self.kind, self.reward, self.steps, strict=True):
            if kind == "unknown":
                allowed.append(settings.unmodelled == "allow")
                continue
            good = kind == "safe" and (settings.r_min is None or reward >= settings.r_min)
            if settings.veto_horizon == "lookahead" and somewhere_safe:
                good = good and steps == SAFE
            allowed.append(good)
        return allowed


def action_maps(model, random):
    """One to one, with actions that the domain does not mention, permuted, and many to one."""
    names = [action.name for action in model.actions]
    count = len(names)
    yield ActionMap(model, count)
    yield ActionMap(model, count + 2)
    order = random.sample(range(count + 1), count)
    yield ActionMap(model, count + 1, dict(zip(names, order, strict=True)))
    for size in (max(1, count - 1), max(1, count // 2) + 1):
        yield ActionMap(model, size, {name: random.randrange(size) for name in names})


def arbiter_of(actions, random, strategy="mixture"):
    """An arbiter with settings of all kinds."""
    settings = Settings(
        arbiter=ArbiterSettings(
            rho=random.choice((0.0, 0.5, 0.5, 1.0)),
            r_min=random.choice((None, None, -0.5, 0.5)),
            veto_horizon=random.choice(("step", "lookahead")),
            unmodelled=random.choice(("allow", "veto")),
        ),
        planner=PlannerSettings(
            depth=random.randint(1, 3), accepted_risk=random.choice((0.0, 0.02, 0.3))
        ),
        guide=GuideSettings(strategy=strategy),
    )
    planner = Lookahead(actions.model, settings.planner)
    strategies = find_strategy(strategy)(settings, random.randrange(10**6))
    return Arbiter(planner, actions, settings.arbiter, strategies)


def proposer_of(learner):
    """The learner, in the form that strategies use."""
    return LearnerProposer(learner, np.zeros(1))
