"""The agent: planner, learner and arbiter, wired for one task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp._util.numbers import FLOAT32_MAX, best_of
from serp._util.saved_state import Saved, nested
from serp.adaptation.adaptation import ModelAdaptation
from serp.adaptation.exploration_bonus import ExplorationBonus
from serp.control.arbiter import Arbiter, Decision, Forecaster
from serp.control.leaf_value_bootstrap import LeafValueBootstrap
from serp.control.strategies.making import make_strategy
from serp.control.strategies.strategy import Learner, Mask, Strategy, Values
from serp.errors import EnvironmentFailure, TaskError
from serp.learning.dqn import DQN, Proposal
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.forecast import Forecast
from serp.planning.lookahead import Lookahead
from serp.planning.replanner import MonitorReplanner
from serp.settings import PlannerSettings, Settings
from serp.sysid.transitions import CUT_OFF, GOES_ON, OVER
from serp.tasks.bound_task import BoundTask
from serp.tasks.reward import Judged, reward_source
from serp.tasks.task_symmetry import TaskSymmetry, declared_symmetries, symmetry_group

Arrays = dict[str, NDArray[Any]]
Meta = dict[str, Any]


class _GraphPlanner:
    """Forecasts of the planning graph, for domains too large to be compiled."""

    def __init__(self, model: TransitionModel, settings: PlannerSettings) -> None:
        self._replanner = MonitorReplanner(
            model,
            depth=settings.depth,
            discount=settings.discount,
            repeat=settings.repeat,
            max_nodes=settings.max_nodes,
            accepted_risk=settings.accepted_risk,
        )

    def forecast(self, state: Vector) -> Forecast:
        return self._replanner.plan(state).forecast


def make_planner(model: TransitionModel, settings: PlannerSettings) -> Forecaster:
    """Return the fastest planner for a model; all give the same decisions."""
    return Lookahead(model, settings) if model.compiles else _GraphPlanner(model, settings)


def _learner_input(inputs: str) -> Callable[[Vector, Vector], Vector]:
    """Return the function (observation, state) → what the learner sees."""
    if inputs == "observation":
        return lambda observation, state: observation
    if inputs == "state":
        return lambda observation, state: state
    return lambda observation, state: np.concatenate((observation, state))


_FOR_LEARNER = (
    f"more than the learner can take, which counts in float32 (up to {FLOAT32_MAX:.2g}); give it "
    "in other units, or within bounds"
)


def _too_large(values: Vector) -> int:
    """Return where a number is not finite in float32; -1 where there is none."""
    fits = np.abs(values) <= FLOAT32_MAX
    return -1 if fits.all() else int(fits.argmin())


class _Asked:
    """The learner before one input."""

    def __init__(self, learner: DQN, x: Vector) -> None:
        self._learner = learner
        self._x = x

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        return _limited(self._learner.propose(self._x, explorable, base), among)

    def propose_greedily(
        self, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        return _limited(self._learner.propose_greedily(self._x, base), among)

    def member_q(self) -> Values:
        return self._learner.member_q(self._x)

    def target_q(self) -> Values:
        return self._learner.target_q(self._x)


class _Greedy(_Asked):
    """The same, where nothing is explored."""

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        return self.propose_greedily(among=among, base=base)


def _limited(proposal: Proposal, among: Mask | None) -> Proposal:
    """Return the best of the actions that a greedy choice is limited to."""
    if among is None or proposal.q is None or among[proposal.action] or not among.any():
        return proposal
    return proposal._replace(action=best_of(proposal.q, among))


class Agent:
    """Planner, learner and arbiter of one task.

    Args:
        task: The task.
        settings: All settings.
        seed: Seed of everything random in the agent.

    Attributes:
        correction: What the model learns from its errors.
        outlook: What the lookahead makes of the learner's values; None for nothing.
        symmetries: Those that the task declares and the learner uses.
        notices: What the user should know: symmetries that the domain file does not have, and a
            model that cannot be corrected.

    Raises:
        TaskError: The task declares a symmetry that makes no sense.
    """

    def __init__(self, task: BoundTask, settings: Settings, seed: int) -> None:
        self.task = task
        self.settings = settings
        self._learns_from = reward_source(task.rewarded_by, settings)
        seeds = np.random.SeedSequence(entropy=seed, spawn_key=(0,)).spawn(5)
        strategy_seed, learner_seed, random_seed, correction_seed, outlook_seed = seeds
        self.correction = ModelAdaptation(task.model, settings.adaptation, correction_seed)
        model = self.correction.model
        planner = make_planner(model, settings.planner)
        tries = 0 if model is task.model else settings.adaptation.min_visits
        if model is task.model:  # then nobody knows whether it is worth imitating
            settings = settings.replace({"arbiter": {"imitation_weight": 0.0}})
        strategy = make_strategy(settings, strategy_seed)
        horizon = settings.planner.depth * settings.planner.repeat
        self.arbiter = Arbiter(
            planner, task.actions.over(model), settings.arbiter, strategy, horizon,
            ExplorationBonus(self.correction.visits, tries), lambda: self.correction.confidence,
        )  # fmt: skip
        self._learner_input = _learner_input(settings.training.inputs)
        self.symmetries: tuple[TaskSymmetry, ...] = ()
        self.notices: tuple[str, ...] = ()
        group = None
        if settings.learner.symmetry:
            self.symmetries, self.notices = declared_symmetries(task)
            group = symmetry_group(task, self.symmetries, settings.training.inputs)
        if self.correction.notice is not None:
            self.notices = (*self.notices, self.correction.notice)
        self.learner = DQN(
            self._input_size(),
            task.actions.size,
            settings.learner,
            learner_seed,
            group,
            guided=strategy.guided,
        )
        self.outlook = None
        if settings.bootstraps_leaves and isinstance(planner, Lookahead):
            self.outlook = LeafValueBootstrap(planner, self.learner, outlook_seed)
        self._random = np.random.default_rng(random_seed)

    def _input_size(self) -> int:
        sizes = {"observation": self.task.observation_size, "state": len(self.task.model.fluents)}
        inputs = self.settings.training.inputs
        return sum(sizes.values()) if inputs == "both" else sizes[inputs]

    def perceive(self, raw: Any) -> tuple[Vector, Vector]:
        """Return the state `[F]` and the learner's input for an observation of the environment.

        Raises:
            EnvironmentFailure: The observation is none of the space, or a number in it is not
                finite, or not in float32, in which the learner counts.
            TaskError: The grounding failed, or gave such a number.
        """
        observation = self.task.observation(raw)
        state = self.task.ground(raw)
        inputs = self.settings.training.inputs
        place = _too_large(observation)
        if place >= 0 and inputs != "state":
            raise EnvironmentFailure(
                f"task {self.task.name}: the observation: {self.task.observations.name(place)} "
                f"is {observation[place]:g}, {_FOR_LEARNER}"
            )
        place = _too_large(state)
        if place >= 0 and inputs != "observation":
            raise TaskError(
                f"task {self.task.name}: grounding: fluent `{self.task.model.fluents[place].name}` "
                f"is {state[place]:g}, {_FOR_LEARNER}"
            )
        return state, self._learner_input(observation, state)

    def observe(
        self,
        state: Vector,
        action: int,
        next_state: Vector,
        judged: Judged,
        terminated: bool,
        truncated: bool,
    ) -> None:
        """Let model and lookahead learn from an env step.

        Arguments are those of `ModelAdaptation.observe` and `LeafValueBootstrap.observe`.
        """
        ending = OVER if terminated else CUT_OFF if truncated else GOES_ON
        # The file's rewards are compared with the environment's only where they stand for these.
        worth = judged.reward if self._learns_from == "environment" else judged.domain_reward
        self.correction.observe(state, action, next_state, ending, worth)
        if self.outlook is not None:
            self.outlook.observe(state, next_state, judged, terminated, truncated)

    def decide(self, state: Vector, x: Vector) -> Decision:
        """Decide by the arbiter, exploration included."""
        return self.arbiter.decide(state, self.before(x))

    def decide_randomly(self, state: Vector) -> Decision:
        """Decide on a uniformly drawn proposal, for D_0; vetoes hold as ever."""
        action = int(self._random.integers(self.task.actions.size))
        return self.arbiter.judge_proposal(state, Proposal(action, True, None))

    def decide_greedily(self, state: Vector, x: Vector) -> Decision:
        """Decide as the trained agent does: by its strategy, without exploration."""
        return self.arbiter.decide_greedily(state, self.before(x))

    def decide_in_turns(self, state: Vector, x: Vector, strategy: Strategy) -> Decision:
        """Decide as in training, with the turns of a strategy, but without exploration."""
        return self.arbiter.decide_in_turns(state, _Greedy(self.learner, x), strategy)

    def decide_alone(self, state: Vector, x: Vector) -> Decision:
        """Let the learner's greedy choice be executed: no planner, no veto."""
        return self.arbiter.let(state, self.before(x))

    def before(self, x: Vector) -> Learner:
        """Return the learner as it stands before an input."""
        return _Asked(self.learner, x)

    def state_dict(self) -> tuple[Arrays, Meta]:
        """Return arrays and JSON values that `load_state_dict` restores exactly."""
        arrays, learner = self.learner.state_dict()
        _, arbiter = self.arbiter.state_dict()
        corrected, correction = self.correction.state_dict()
        saved = nested("learner", arrays) | nested("correction", corrected)
        meta = {
            "learner": learner,
            "correction": correction,
            "arbiter": arbiter,
            "random": self._random.bit_generator.state,
        }
        if self.outlook is not None:
            seen, meta["outlook"] = self.outlook.state_dict()
            saved |= nested("outlook", seen)
        return saved, meta

    def load_state_dict(self, arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> None:
        """Restore what `state_dict` returned.

        Raises:
            RunError: The learner has another shape, or something is damaged.
        """
        saved = Saved("agent", arrays, meta)
        self.learner.load_state_dict(*saved.part("learner"))
        self.correction.load_state_dict(*saved.part("correction"))
        self.arbiter.load_state_dict(*saved.part("arbiter"))
        if self.outlook is not None:
            self.outlook.load_state_dict(*saved.part("outlook"))
        self._random.bit_generator.state = saved.generator_state("random", self._random)
