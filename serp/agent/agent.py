"""The agent: planner, learner and arbiter of one task."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import FLOAT32_MAX
from serp._util.saved_state import Saved, nested
from serp.agent.arbiter import Arbiter
from serp.agent.decision import Decision
from serp.agent.protocols import LearnerProposer, Stateful, undisturbed
from serp.agent.registry import find_learner, find_strategy, make_planner
from serp.agent.step_record import StepRecord
from serp.agent.strategy import Strategy
from serp.agent.veto import VetoPolicy
from serp.errors import EnvironmentFailure, SettingsError, TaskError
from serp.learning.dqn import Proposal
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.transition_model import Vector
from serp.planning.forecast import SAFE
from serp.settings import Settings
from serp.tasks.action_map import ActionForecast
from serp.tasks.environment import BoundTask
from serp.tasks.task import reward_source

MIN_VISITS = 4
"""In training, a planner prefers actions that were observed fewer times."""


def exploration_bonus(
    visits: NDArray[np.int64], min_visits: int, forecast: ActionForecast
) -> ActionForecast:
    """Return a forecast whose choice is the least visited action that is safe.

    Args:
        visits: `[A]` how often each ground action was observed.
        min_visits: Actions with fewer visits are preferred; 0: none.
        forecast: The forecast, which is returned where no action is preferred.
    """
    if not np.count_nonzero(visits < min_visits):
        return forecast
    candidates = forecast.safe
    lasting = candidates & (forecast.safe_steps == SAFE)
    if np.count_nonzero(lasting):
        candidates = lasting
    # If all known actions become unsafe, an unknown one is the better choice.
    visits = visits[forecast.ground]
    candidates &= visits < min_visits
    if not np.count_nonzero(candidates):
        return forecast
    least = np.where(candidates, visits, min_visits)
    return forecast._replace(choice=int(least.argmin()))


class Agent:
    """Planner, learner and arbiter of one task.

    Args:
        task: The task.
        settings: All settings.
        seed: Seed of everything random in the agent.
        baseline: Whether the learner always acts, and nothing is refused.

    Attributes:
        arbiter: The arbiter used in training.
        guarded: The arbiter with vetoes; other than `arbiter` only for a baseline.
        adaptation: The adaptation of the model.
    """

    def __init__(
        self, task: BoundTask, settings: Settings, seed: int, *, baseline: bool = False
    ) -> None:
        self.task = task
        self.settings = settings
        # Wrong names are refused first, because what follows takes time.
        make_strategy = Strategy if baseline else find_strategy(settings.guide.strategy)
        make_learner = find_learner(settings.learner.name, task.task.learners)
        if settings.planner.discount >= 1.0:
            raise SettingsError(
                "planner.discount: with a learner, it must be less than 1, for example 0.999"
            )
        self._learns_from = reward_source(task.rewarded_by, settings)
        seeds = np.random.SeedSequence(entropy=seed, spawn_key=(0,)).spawn(4)
        strategy_seed, learner_seed, random_seed, adaptation_seed = seeds
        self.adaptation = ModelAdaptation(task.model, settings.adaptation, adaptation_seed)
        model = self.adaptation.model
        actions = task.actions.over(model)
        strategy = make_strategy(settings, strategy_seed)
        planner = make_planner(model, settings.planner, task.task.planners)
        if hasattr(planner, "visited"):
            planner.visited = self.adaptation.experience
        self.guarded = Arbiter(
            planner,
            actions,
            settings.arbiter,
            strategy,
            vetoes=VetoPolicy(actions, settings.arbiter, settings.planner.depth),
            exploration_bonus=functools.partial(
                exploration_bonus,
                self.adaptation.visits,
                MIN_VISITS if model is not task.model else 0,
            ),
        )
        self.arbiter = self.guarded
        if baseline:
            vetoes = VetoPolicy(actions, settings.arbiter, refuses=False)
            self.arbiter = Arbiter(planner, actions, settings.arbiter, strategy, vetoes=vetoes)
        inputs = task.observation_size + len(task.model.fluents)
        if not inputs:
            raise TaskError(
                f"task {task.name}: the learner has no input, because the observation holds no "
                "number and the domain file declares no predicate or function"
            )
        self.learner = make_learner(
            inputs,
            task.actions.size,
            settings.learner,
            learner_seed,
            imitates=strategy.imitates,
            discount=settings.planner.discount,
        )
        self._random = np.random.default_rng(random_seed)
        self._waiting: dict[int, list[tuple[tuple[Vector, int, Vector, bool, float], bool]]] = {}
        """Episode → steps to learn from, and whether each is the last; in order of the episodes."""

    @property
    def strategy(self) -> Strategy:
        """The strategy, which makes the proposals."""
        return self.arbiter.strategy

    def perceive(
        self, raw: Any, info: Mapping[str, Any] | None = None, env: gym.Env[Any, Any] | None = None
    ) -> tuple[Vector, Vector]:
        """Return the state `[F]` and the learner's input for an observation of the environment.

        The environment's info and the environment are needed if the task's grounding takes them.

        Raises:
            EnvironmentFailure: The observation is no member of the space, or not finite in float32.
            TaskError: The grounding failed, or gave a number that is not finite in float32.
        """
        return self.take_in(self.task.observation(raw), self.task.ground(raw, info, env))

    def take_in(self, observation: Vector, state: Vector) -> tuple[Vector, Vector]:
        """Return the state and the learner's input for an observation and its state, checked.

        Errors are those of `perceive`; the observation is a flat vector.
        """
        x = np.concatenate((observation, state))
        fits = np.abs(x) <= FLOAT32_MAX
        if np.count_nonzero(fits) < len(fits):  # `all` takes five times as long
            task, place = self.task, int(fits.argmin())
            advice = (
                "too large for the learner, which computes in float32 (up to "
                f"{FLOAT32_MAX:.2g}); use other units, or clip it"
            )
            if place < len(observation):
                name = task.observations.name(place)
                raise EnvironmentFailure(
                    f"task {task.name}: the observation: {name} is {x[place]:g}, {advice}"
                )
            name = task.model.fluents[place - len(observation)].name
            raise TaskError(
                f"task {task.name}: grounding: fluent `{name}` is {x[place]:g}, {advice}"
            )
        return state, x

    def turn_to(self, env_index: int) -> None:
        """Note from which of several environments, from 0, the next calls come."""
        self.strategy.env_index = self.arbiter.vetoes.env_index = self.learner.env_index = env_index

    def prefetch(self, states: Mapping[int, Vector]) -> AbstractContextManager[None]:
        """Have the forecasts for the next decisions at hand in the body.

        `states` are those of several environments, by number.
        """
        needed = []
        for env_index, state in states.items():
            self.turn_to(env_index)
            if self.strategy.needs_plan():
                needed.append(state)
        return self.arbiter.prefetch(needed)

    def decide(self, state: Vector, x: Vector) -> Decision:
        """Decide as in training, with exploration."""
        return self.arbiter.decide(state, LearnerProposer(self.learner, x))

    def decide_randomly(self, state: Vector) -> Decision:
        """Decide on a uniformly drawn proposal, for D_0; the vetoes hold."""
        action = int(self._random.integers(self.task.actions.size))
        return self.arbiter.judge_proposal(state, Proposal(action, True))

    def decide_greedily(self, state: Vector, x: Vector) -> Decision:
        """Decide as the trained agent does: by its strategy, without exploration."""
        return self.arbiter.decide_greedily(state, LearnerProposer(self.learner, x))

    def observe(self, step: StepRecord, episode: int = 0) -> None:
        """Update vetoes and model with an env step of training; notify when vetoes see less far.

        The model learns from whole episodes, one after another in the order in which they begin,
        from each step as soon as it is that episode's turn. Of episodes that run at the same time,
        the steps of the later ones wait: in a mixture of all, what the episodes have in common at
        their ends (a robot that has landed) would look like a change of the world.

        Args:
            step: The env step.
            episode: Number of its episode, where several run at the same time.
        """
        vetoes, on_notice = self.arbiter.vetoes, self.task.on_notice
        relied_on = vetoes.reliability.reliable
        if vetoes.observe(step):
            self.adaptation.reset_visits()
        if relied_on and not vetoes.reliability.reliable and on_notice is not None:
            on_notice(
                f"{vetoes.reliability}, a step was unsafe although the lookahead had predicted a "
                "safe path. From now on, vetoes consider only the next step. Check the effects of "
                "the actions in the domain file."
            )
        # The file's rewards are compared with the environment's only if they model these.
        reward = step.reward if self._learns_from == "environment" else step.domain_reward
        self.adaptation.visit(step.ground)
        self._waiting.setdefault(episode, []).append(
            ((step.state, step.ground, step.next_state, step.terminated, reward), step.last)
        )
        while self._waiting:
            first, steps = next(iter(self._waiting.items()))
            for observed, _ in steps:
                self.adaptation.observe(*observed)
            if steps and steps[-1][1]:
                del self._waiting[first]
            else:
                steps.clear()
                break

    def cut_off(self) -> None:
        """Treat the env step observed last as if it had truncated its episode.

        This is for a single environment whose episode is not gone on with.
        """
        self.arbiter.vetoes.cut_off()
        self._waiting.clear()

    def remember(self, step: StepRecord, following: Decision | None = None) -> None:
        """Store an env step to be learned from, given the decision after it in its episode."""
        lesson = self.strategy.lesson(step, following)
        self.learner.remember(
            step.x, step.decision.action, lesson.reward, step.next_x, step.terminated,
            step.truncated, lesson.imitated, lesson.allowed,
        )  # fmt: skip

    def learn(self) -> float | None:
        """Make the learner's updates of one env step; return their mean loss, None for none."""
        self.learner.imitation_weight = self.strategy.imitation_weight
        return self.learner.learn()

    def state_dict(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays, learner = self.learner.state_dict()
        adapted, adaptation = self.adaptation.state_dict()
        saved = nested("learner", arrays) | nested("adaptation", adapted)
        meta = {
            "learner": learner,
            "adaptation": adaptation,
            "arbiter": self.arbiter.state_dict(),
            "random": self._random.bit_generator.state,
        }
        if isinstance(self.arbiter.planner, Stateful):
            planner, meta["planner"] = self.arbiter.planner.state_dict()
            saved |= nested("planner", planner)
        return saved, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: The learner has another shape, or something is damaged.
        """
        saved = Saved("agent", arrays, meta)
        self.learner.load_state_dict(*saved.part("learner"))
        self.adaptation.load_state_dict(*saved.part("adaptation"))
        self.arbiter.load_state_dict(saved.part("arbiter")[1])
        if isinstance(self.arbiter.planner, Stateful):
            self.arbiter.planner.load_state_dict(*saved.part("planner"))
        self._random.bit_generator.state = saved.generator_state("random", self._random)

    def undisturbed(self) -> AbstractContextManager[None]:
        """Restore, at the end, what the planner kept from one decision to the next."""
        return undisturbed(self.arbiter.planner)


def account_of(agent: Agent) -> dict[str, Any]:
    """Return JSON values on an agent as it is now.

    Returns:
        ``trained_policy``: in words, what the policy `serp` does. ``evidence``: why, from the
        returns of planner and learner; null for strategies that do not go by evidence. ``model``:
        which learned parts the planner's model uses, and why others are not in use. ``safety``: in
        words, how often the lookahead failed. ``risk``: how well risks were predicted, and what
        they held back; empty where there was no risk.
    """
    evidence = agent.strategy.evidence
    return {
        "trained_policy": agent.strategy.choice,
        "evidence": None if evidence is None else evidence.as_dict(),
        "model": agent.adaptation.adoption.as_dict(),
        "safety": agent.arbiter.vetoes.account(),
        "risk": agent.arbiter.vetoes.account_of_risk(),
    }
