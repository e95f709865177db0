"""The six sections of the settings, with the range of every value.

The docstring under a setting is its documentation; the reference page is generated from them.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from serp._util.numbers import COUNTED, SIZE
from serp.settings.section import Section

MAX_PERIODS: Final = 10_000
"""Largest depth, and largest number of repetitions of an action."""

Probability = Annotated[float, Field(ge=0, le=1)]
"""A number from 0 to 1."""
Finite = Annotated[float, Field(allow_inf_nan=False)]
"""A number, neither infinite nor NaN."""
Nonnegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Periods = Annotated[int, Field(ge=1, le=MAX_PERIODS)]
Count = Annotated[int, Field(ge=0, le=COUNTED)]
PositiveCount = Annotated[int, Field(ge=1, le=COUNTED)]
Size = Annotated[int, Field(ge=1, le=SIZE)]


class PlannerSettings(Section):
    """Depth, budget and preferences of the planner."""

    name: str = "lookahead"
    """The planner, by the name of its entry point in the group `serp.planners`, or of
    `Task.planners`. `a+b` names several; the strategy `evidence` finds the better one. What follows
    a colon is for the planner itself."""
    depth: Periods = 5
    """Lookahead in actions."""
    discount: Annotated[float, Field(gt=0, le=1)] = 0.99
    """Weight of a reward one control period later."""
    repeat: Periods = 1
    """Control periods for which one edge of the graph repeats its action. The executed action is
    still chosen anew in every period."""
    max_nodes: PositiveCount = 10_000
    """Most nodes that are expanded. A layer that would exceed the budget is not expanded, and the
    plan ends at the deepest complete layer. The first layer is always expanded."""
    accepted_risk: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Largest predicted probability of damage that one decision may add, in the step itself or on
    the path that follows. An action whose step has no larger risk counts as safe; a path that risks
    at most so much more than the least counts as one of the least risk, unless it is certain to do
    damage. 0: the least risk comes before any reward. A model that is not adapted predicts no such
    probabilities."""


class AdaptationSettings(Section):
    """Online adaptation of the model by its one-step errors."""

    mode: Literal["off", "parameters", "residual", "full"] = "off"
    """`off`: the errors are only recorded. `parameters`: the numbers in effects and rates are
    estimated. `residual`: a model of the remaining one-step error is learned. `full`: both."""
    min_visits: Count = 0
    """In training, when it is the planner's turn, it prefers actions observed fewer times than
    this that are predicted safe. 0, or mode `off`: never."""

    @property
    def residual(self) -> bool:
        """Whether a residual is learned."""
        return self.mode in ("residual", "full")

    @property
    def parameters(self) -> bool:
        """Whether parameters of the file are estimated."""
        return self.mode in ("parameters", "full")


class ArbiterSettings(Section):
    """Which of planner and learner acts, and which actions are vetoed."""

    rho: Probability = 0.0
    """Initial learner probability ρ."""
    rho_increment: Probability = 0.01
    """Δρ: increase of ρ at the end of each unit."""
    rho_unit: str = "episode"
    """`step`, `episode`, or the name of a counter in the environment's `info`, such as `game`:
    ρ grows whenever it changes."""
    r_min: Finite | None = None
    """R_min: a proposal with a smaller predicted reward is vetoed. None: no proposal is."""
    veto_horizon: Literal["step", "lookahead"] = "lookahead"
    """`step` vetoes what the next step predicts. `lookahead` also vetoes what leads, within the
    lookahead, to a state in which every action is unsafe, while another action does not, unless
    the lookahead has failed too often to predict what is unsafe."""
    unmodelled: Literal["allow", "veto"] = "allow"
    """What to do with environment actions that the domain does not mention."""


class GuideSettings(Section):
    """How planner and learner share the decisions. Vetoes apply under every strategy."""

    strategy: str = "mixture"
    """The strategy, by the name of its entry point in the group `serp.strategies`. `mixture` is
    Algorithm 1, with the learner probability ρ of section `arbiter`."""


class LearnerSettings(Section):
    """The learner, a DQN.

    The defaults are a recipe that works on small control tasks. The preset `paper` has the
    learner of the paper's section 4.
    """

    name: str = "dqn"
    """The learner, by the name of its entry point in the group `serp.learners`."""
    hidden: tuple[Size, ...] = (64, 64)
    """Neurons of each hidden layer; none makes Q linear in the input."""
    layer_norm: bool = False
    """LayerNorm (arXiv 1607.06450) in every hidden layer, before its ReLU."""
    members: Size = 1
    """Networks of the ensemble. Each learns from separate batches; Q is their mean."""
    symmetry: bool = False
    """Use the task's symmetries, if it has any: every sample drawn is mirrored at random, and Q is
    averaged over the mirror images of its input."""
    learning_rate: Positive = 0.001
    """Step size of Adam."""
    discount: Annotated[float, Field(ge=0, lt=1)] = 0.99
    """γ: weight of the reward of the next step."""
    batch_size: Size = 64
    """Samples in one gradient update of one network."""
    updates_per_step: Nonnegative = 1.0
    """Gradient updates per env step; 0.5 is one in every second step."""
    target_period: PositiveCount | None = 200
    """Gradient updates between two copies of the network to the target network. None: never."""
    target_polyak: Annotated[float, Field(gt=0, le=1)] | None = None
    """Polyak averaging: move the target network towards the network by this fraction after every
    gradient update. None: never. At most one of `target_period` and `target_polyak` is given;
    with neither there is no target network, as in the paper's equation 3."""
    double: bool = True
    """Double DQN (arXiv 1509.06461): the network chooses the next action, the target network
    estimates its value. No effect without a target network."""
    n_step: Annotated[int, Field(ge=1, le=10_000)] = 3
    """n of n-step returns: rewards summed before the estimated value of a later state."""
    clip_targets: bool = True
    """Clip estimated values to the range of possible returns."""
    mask_targets: bool = True
    """The value of the next state is that of its best admissible action. False: of its best
    action, as in the paper's equation 3."""
    loss: Literal["mse", "huber"] = "mse"
    """Loss of one sample: squared error (paper, equation 2), or the Huber loss with threshold 1."""
    reward_scale: Positive = 1.0
    """Factor on rewards; Q-values are in the scaled unit."""
    gradient_clip: Positive | None = 10.0
    """Largest Euclidean norm of the gradient of one network. None: unlimited."""
    epsilon_start: Probability = 1.0
    """Probability of exploring in the first env step."""
    epsilon_end: Probability = 0.05
    """Probability of exploring from env step `epsilon_steps` on."""
    epsilon_steps: Count = 4000
    """Env steps over which the probability changes linearly between the two."""
    buffer_size: Annotated[int, Field(ge=1, le=10**14)] = 50_000
    """Samples in the replay buffer; the oldest is overwritten."""
    learning_starts: Count = 200
    """Env steps before the first gradient update."""
    pretrain_updates: Count = 0
    """Gradient updates on the initial data D₀ before training (Algorithm 1, line 1)."""

    @model_validator(mode="after")
    def _consistent(self) -> LearnerSettings:
        if self.target_period is not None and self.target_polyak is not None:
            raise ValueError(
                f"target_polyak is {self.target_polyak!r}, but must be none while "
                f"target_period is {self.target_period}"
            )
        return self

    @property
    def has_target(self) -> bool:
        """Whether there is a target network."""
        return self.target_period is not None or self.target_polyak is not None


class TrainingSettings(Section):
    """Settings of the training loop."""

    reward: Literal["task", "domain", "environment", "sum"] = "task"
    """The reward that the learner learns from: the one that the `task` declares (`Task.reward`),
    that of the `domain` file, that of the `environment`, or the `sum` of the latter two. The
    planner always uses the domain file."""
    inputs: Literal["observation", "state", "both"] = "both"
    """The input of the learner: the `observation`, the grounded `state`, or `both`."""
    num_envs: Annotated[int, Field(ge=1, le=1024)] = 1
    """Environments that are stepped at the same time, each in a process of its own if there are
    several. They share learner, model and budget. Runs are then saved and stopped only where no
    episode is running in any of them."""
    random_steps: Count = 0
    """Size of D₀ in env steps: actions are drawn uniformly (vetoes apply), and the learner is
    pretrained on them before Algorithm 1 starts."""
    env_steps: PositiveCount = 20_000
    """Default budget of a training in env steps."""
    units: PositiveCount | None = None
    """Default budget in units of `arbiter.rho_unit`, such as games, instead of env steps. None: in
    env steps."""
    episode_steps: PositiveCount = 10_000
    """Steps after which an episode is truncated that the environment does not end. Runs are saved
    and stopped only between episodes."""
    checkpoint_seconds: Annotated[float, Field(ge=0)] = 15.0
    """Longest time between two checkpoints. They are written between episodes, more often where
    writing takes little time."""
    slow_step_seconds: Annotated[float, Field(gt=0)] = 30.0
    """A step or reset of the environment that takes longer is reported while it lasts, once per
    run. Infinity: never."""
    record: bool = True
    """Whether to record every step: state, decision, and all that was predicted. `serp why` needs
    it."""
    tensorboard: bool | Literal["steps"] = False
    """Whether to write TensorBoard events as well (extra `tensorboard`): `true` for every episode,
    `steps` for every env step, too, which takes about 0.15 ms more per step."""
