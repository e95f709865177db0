"""The six sections of the settings, with the range of every value.

The docstring under a setting is its documentation; the reference page is made of them.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from serp._util.numbers import COUNTED, SIZE
from serp.settings.base import Section

MAX_PERIODS: Final = 10_000
"""Largest depth, and most repetitions of an action: no plan looks farther ahead."""

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
SizeOrZero = Annotated[int, Field(ge=0, le=SIZE)]


class PlannerSettings(Section):
    """How far and how hard the planner looks."""

    name: str = "lookahead"
    """The planner, by the name of its entry point in the group `serp.planners`."""
    depth: Periods = 5
    """Lookahead in actions."""
    discount: Annotated[float, Field(gt=0, le=1)] = 0.99
    """Weight of a reward one control period later."""
    repeat: Periods = 1
    """Control periods that one edge of the graph stands for. The executed action is still
    reconsidered in every period."""
    max_nodes: PositiveCount = 10_000
    """Most nodes that are expanded. A layer that would exceed it is not expanded; the deepest
    complete layer counts. The first layer is always expanded."""
    accepted_risk: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Largest predicted probability of something unsafe that an action may have and still pass
    for safe. A model that does not adapt predicts none."""
    leaf_value: Literal["never", "indifferent", "always"] = "never"
    """When the states of the last layer are worth what the learner estimates, once its
    estimates have proven right: `never`, only where the planner is otherwise `indifferent`, or
    `always`. Needs the strategy `mixture` and a learner that sees the state."""


class AdaptationSettings(Section):
    """What is made of the model's one-step errors."""

    mode: Literal["off", "parameters", "residual", "full"] = "off"
    """`off`: the errors are recorded only. `parameters`: the numbers of effects and rates are
    estimated again. `residual`: what the file leaves out is learned beside it. `full`: both."""
    nonlinear: bool = True
    """Whether a residual may use random Fourier features where a linear one leaves something
    unexplained."""
    min_visits: Count = 0
    """In its turn, in training, the planner prefers an action that it has seen fewer times,
    where that action is predicted safe. 0, or mode `off`: never."""

    @property
    def residual(self) -> bool:
        """Whether a residual is learned."""
        return self.mode in ("residual", "full")

    @property
    def parameters(self) -> bool:
        """Whether parameters of the file are estimated again."""
        return self.mode in ("parameters", "full")


class ArbiterSettings(Section):
    """Who acts, and what is vetoed."""

    rho: Probability = 0.0
    """Learner probability ρ at the start."""
    rho_increment: Probability = 0.01
    """Δρ: what ρ gains at the end of each unit."""
    rho_unit: str = "episode"
    """`step`, `episode`, or the name of a counter in the environment's `info`, such as `game`:
    ρ grows whenever it changes."""
    rho_max: Probability = 1.0
    """Largest ρ."""
    confidence_margin: Nonnegative | None = None
    """In the planner's turn the learner's choice is executed all the same where its networks
    agree that it is better: where the mean of their differences of Q exceeds so many standard
    deviations. Not where the model has predicted well, nor in the first ten episodes of a model
    that adapts. None: never."""
    imitation_weight: Nonnegative = 0.0
    """Weight of the learner's imitation loss where the model has predicted well: the planner's
    choice is to be worth a margin more than any other, unless the planner is indifferent."""
    r_min: Finite | None = None
    """R_min: a proposal with a smaller predicted reward is vetoed. None vetoes none."""
    veto_horizon: Literal["step", "lookahead"] = "lookahead"
    """`step` vetoes what the next step predicts. `lookahead` also vetoes what leads, within the
    lookahead, to a state in which every action is unsafe, while another action does not."""
    max_lookahead_failures: Count | None = None
    """So many times something unsafe may happen that the lookahead said could be avoided. After
    that only the prediction of the next step vetoes. None: the lookahead is always relied
    on."""
    exploration_slack: Annotated[float, Field(ge=0)] | None = None
    """None: the learner explores among all actions, and vetoes follow. A number: it explores
    only among the admissible actions whose best plan is worth no less than the best plan minus
    this. Infinity: among all admissible ones."""
    after_veto: Literal["planner", "learner"] = "planner"
    """Who acts where a greedy proposal is vetoed: the `planner` (Algorithm 1), or the `learner`
    with its best admissible action. A vetoed exploration is always followed by the planner."""
    unmodelled: Literal["allow", "veto"] = "allow"
    """What to do with environment actions that the domain does not mention."""
    indifferent: Literal["first", "learner"] = "learner"
    """Who acts in the planner's turn where all plans are worth the same: `first` takes the
    first action in the file, `learner` asks the learner."""

    @model_validator(mode="after")
    def _starts_below_its_maximum(self) -> ArbiterSettings:
        if self.rho > self.rho_max:
            raise ValueError(
                f"rho starts at {self.rho!r}, above its maximum rho_max {self.rho_max!r}"
            )
        return self


class GuideSettings(Section):
    """How planner and learner share the decisions. The vetoes hold under every strategy."""

    strategy: str = "mixture"
    """The strategy, by the name of its entry point in the group `serp.strategies`. `mixture` is
    Algorithm 1, by the learner probability ρ of section `arbiter`."""
    jump_stages: PositiveCount = 10
    """`jump-start`: in so many stages the planner's part of an episode goes to 0."""
    jump_tolerance: Nonnegative = 0.1
    """`jump-start`: how much worse than the best a mean return may be for the next stage, as a
    share of its size."""
    restrict_slack: Nonnegative = 0.2
    """`restrict`: how much worse than the best plan a plan may be, as a share of the best
    plan's worth."""
    imitation_steps: PositiveCount = 1_000
    """`imitate-then-learn`: env steps of imitation at most. `dqfd`: env steps of demonstration."""
    margin: Nonnegative = 0.8
    """`imitate-then-learn`, `dqfd`: by how much the planner's action is to be worth more than
    the others, in units of Q."""


class LearnerSettings(Section):
    """The learner: every choice of the paper and of what is known to work better.

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
    """Networks of the ensemble. Each learns from batches of its own; Q is their mean."""
    symmetry: bool = False
    """Use the task's symmetries, where it has any: every sample drawn is mirrored at random,
    and Q is averaged with its mirror images."""
    learning_rate: Positive = 0.001
    """Step size of Adam."""
    discount: Annotated[float, Field(ge=0, lt=1)] = 0.97
    """γ: what the reward of the next step is worth now."""
    batch_size: Size = 64
    """Samples in one gradient update of one network."""
    updates_per_step: Nonnegative = 1.0
    """Gradient updates per env step; 0.5 is one in every second step."""
    target_period: PositiveCount | None = 200
    """Copy the network to the target network every so many gradient updates. None: never."""
    target_polyak: Annotated[float, Field(gt=0, le=1)] | None = None
    """Move the target network towards the network by this share after every gradient update.
    None: never. At most one of `target_period` and `target_polyak` is given; with neither there
    is no target network, as in the paper's equation 3."""
    double: bool = True
    """Choose the next action by the network, value it by the target network (arXiv 1509.06461).
    Without a target network both are the same."""
    n_step: Annotated[int, Field(ge=1, le=10_000)] = 3
    """Rewards summed before the value of a later state is estimated."""
    clip_targets: bool = True
    """Keep estimated values between the smallest and the largest possible return."""
    mask_targets: bool = True
    """Value the next state by its best admissible action. False: by its best action, as in the
    paper's equation 3."""
    loss: Literal["mse", "huber"] = "mse"
    """Loss of one sample: squared error (paper, equation 2), or Huber with its corner at 1."""
    reward_scale: Positive = 1.0
    """Rewards are multiplied by it; Q-values are in these scaled units."""
    gradient_clip: Positive | None = 10.0
    """Largest Euclidean norm of the gradient of one network. None: unlimited."""
    epsilon_start: Probability = 1.0
    """Probability of exploring in the first env step."""
    epsilon_end: Probability = 0.05
    """Probability of exploring from env step `epsilon_steps` on."""
    epsilon_steps: Count = 4000
    """Env steps in which the probability moves in a straight line between the two."""
    buffer_size: Annotated[int, Field(ge=1, le=10**14)] = 50_000
    """Samples in the replay buffer; the oldest is overwritten."""
    learning_starts: Count = 200
    """Nothing is learned before so many env steps."""
    protected_share: Probability = 0.1
    """Share of every batch that comes from the protected samples: half from early ones, half
    from failing ones. 0: none are kept."""
    protected_early: SizeOrZero = 1000
    """The first so many samples are kept for ever."""
    protected_failing: SizeOrZero = 1000
    """So many failing samples are kept; the oldest of them is overwritten."""
    failing_window: Size = 10
    """Samples of so many last env steps up to a failure are failing ones; at most `buffer_size`."""
    pretrain_updates: Count = 0
    """Gradient updates on the first data D₀ before anything else (Algorithm 1, line 1)."""

    @model_validator(mode="after")
    def _consistent(self) -> LearnerSettings:
        if self.target_period is not None and self.target_polyak is not None:
            raise ValueError(
                f"target_polyak is {self.target_polyak!r}, but must be none while "
                f"target_period is {self.target_period}"
            )
        if self.failing_window > self.buffer_size:
            raise ValueError(
                f"failing_window is {self.failing_window}, but must be at most buffer_size, "
                f"which is {self.buffer_size}"
            )
        return self

    @property
    def has_target(self) -> bool:
        """Whether there is a target network."""
        return self.target_period is not None or self.target_polyak is not None


class TrainingSettings(Section):
    """Settings of the training loop."""

    reward: Literal["task", "domain", "environment", "sum"] = "task"
    """What the learner learns from: what the `task` declares (`Task.reward`), the rewards of
    the `domain` file, the `environment`'s, or the `sum` of both. The planner always uses the
    domain file."""
    inputs: Literal["observation", "state", "both"] = "both"
    """What the learner sees: the `observation`, the grounded `state`, or `both`."""
    random_steps: Count = 0
    """Size of D₀ in env steps: actions drawn uniformly (the vetoes hold), on which the learner
    is pretrained before Algorithm 1 starts."""
    env_steps: PositiveCount = 20_000
    """Budget of a training for which none is given."""
    units: PositiveCount | None = None
    """Budget of such a training in units of `arbiter.rho_unit` (games, say), instead of env
    steps. None: no such budget."""
    episode_steps: PositiveCount = 10_000
    """An episode that the environment does not end is truncated after so many steps: runs are
    saved and stopped between episodes."""
    checkpoint_seconds: Annotated[float, Field(ge=0)] = 15.0
    """Most time between two checkpoints, which are made between episodes; they are made more
    often where they are cheap."""
    slow_step_seconds: Annotated[float, Field(gt=0)] = 30.0
    """A step or reset of the environment that takes longer is reported while it hangs, once a
    run. Infinity: none is."""
    tensorboard: bool = False
    """Whether to write TensorBoard events as well (extra `tensorboard`)."""
