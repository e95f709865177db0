"""Transitions to learn from: of the real cart-pole, of an icy cliff, and of any model."""

import functools

import gymnasium as gym
import numpy as np

from serp.model.domain import Domain, load_domain
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.learned.transitions import TransitionMemory
from serp.pddl.source import Source
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings
from tests.worlds import DOMAINS

DT = 0.02
"""Control period of cart-pole, seconds."""


def from_text(text, problem=None):
    """A domain from its text, without a file."""
    problem_source = None if problem is None else Source("world-problem.pddl", problem)
    return Domain.parse(Source("world.pddl", text), problem_source)


@functools.cache
def cartpole(name="cartpole"):
    """A shipped domain file of cart-pole."""
    return load_domain(DOMAINS / f"{name}.pddl")


@functools.cache
def planner(text):
    """The planner of a cart-pole file."""
    settings = PlannerSettings(depth=5, discount=0.99)
    return Lookahead(from_text(text).model.replace(dt=DT), settings)


@functools.cache
def balance(text, seed, steps, noise=0.0):
    """The real cart-pole under the planner of a file: its transitions, and how often it fell.

    `noise` is the share of the actions that are random.
    """
    env = gym.make("serp_envs:serp/CartPole-v0")
    rng = np.random.default_rng(seed)
    experience = TransitionMemory(steps, 4, 9)
    falls = 0
    observation, _ = env.reset(seed=seed)
    for _ in range(steps):
        state = np.asarray(observation, dtype=np.float64)
        random = rng.random() < noise
        action = int(rng.integers(2)) if random else planner(text).forecast(state).choice
        observation, _, terminated, truncated, _ = env.step(action)
        after = np.asarray(observation, dtype=np.float64)
        reward = cartpole().model.judge(state, action, after).reward
        experience.add(state, action, after, terminated, reward)
        falls += terminated
        if terminated or truncated:
            observation, _ = env.reset()
    env.close()
    return experience, falls


def imagined(model, states, rng, noise=0.0):
    """What a model says of random actions in given states, plus noise on numeric fluents."""
    experience = TransitionMemory(len(states), len(model.fluents), len(model.actions))
    numeric = np.array([fluent.numeric for fluent in model.fluents])
    actions = rng.integers(len(model.actions), size=len(states))
    errors = numeric * rng.normal(scale=noise, size=states.shape)
    for state, action, error in zip(states, actions.tolist(), errors, strict=True):
        out, flags = model.transition(state.tolist(), action)
        if flags & APPLICABLE:
            after = np.array(out[: len(state)]) + error
            experience.add(state, action, after, bool(flags & TERMINAL), out[-1])
    return experience


def on_ice(domain, seed, *, steps=2_000, teleports=False):
    """Random steps on the icy cliff, with the rewards of its file.

    If it `teleports`, a fall shows the start, as Gymnasium's environment has it, not its end.
    """
    from serp_adapters import cliff

    env = gym.make("CliffWalkingSlippery-v1") if teleports else cliff.make_env()
    moves = {"up": 0, "right": 1, "down": 2, "left": 3}
    rng = np.random.default_rng(seed)
    experience = TransitionMemory(steps, 2, len(domain.model.actions))
    cell, _ = env.reset(seed=seed)
    for _ in range(steps):
        action = int(rng.integers(4))
        after, _, terminated, truncated, _ = env.step(moves[domain.model.actions[action].name])
        state, next_state = (np.asarray(cliff.ground(c), float) for c in (cell, after))
        reward = domain.model.judge(state, action, next_state).reward
        experience.add(state, action, next_state, terminated, reward)
        cell = after
        if terminated or truncated:
            cell, _ = env.reset()
    return experience
