"""All settings of a training."""

from __future__ import annotations

import json
from collections.abc import ItemsView, Iterable, Mapping
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator
from pydantic_core import ErrorDetails

from serp._util.did_you_mean import did_you_mean
from serp._util.numbers import COUNTED, SIZE
from serp.errors import SettingsError

_WANTED = {
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "bool_type": "must be true or false",
    "string_type": "must be a string",
    "tuple_type": "must be a list",
}
"""Pydantic's error type → the message."""


class _Validated(BaseModel):
    """Immutable values; what is outside its range, of another type, or unknown is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            refused = [_refusal(type(self), each) for each in error.errors(include_url=False)]
            raise SettingsError("; ".join(dict.fromkeys(refused))) from None

    @classmethod
    def section(cls) -> str:
        """Return the section's name: `PlannerSettings` is `planner`."""
        return cls.__name__.removesuffix("Settings").lower() or "settings"


class Section(_Validated):
    """A section of the settings: immutable, and validated on creation.

    NumPy numbers are converted to Python numbers. Booleans and NaN are not accepted as numbers.
    """

    @field_validator("*", mode="before")
    @classmethod
    def _as_python(cls, value: Any) -> Any:
        if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 1):
            value = value.tolist()
        return tuple(map(cls._as_python, value)) if isinstance(value, list | tuple) else value

    def replace(self, **changes: Any) -> Self:
        """Return the section with other values."""
        return type(self)(**{**dict(self), **changes})

    def as_dict(self) -> dict[str, Any]:
        """Return setting → JSON value (tuples as lists)."""
        return {name: list(v) if isinstance(v, tuple) else v for name, v in self}


def setting_value(text: str) -> Any:
    """Return the value of a setting that a text gives: JSON where it is, `none`, or text."""
    text = text.strip()
    words = {"none": None, "None": None, "True": True, "False": False}
    try:
        value = words[text] if text in words else json.loads(text)
    except (ValueError, RecursionError):
        return text
    return tuple(value) if isinstance(value, list) else value


def assigned(texts: Iterable[str]) -> Changes:
    """Return section → setting → value of `section.name=value` texts; see `setting_value`.

    Whether section and setting exist is for `Settings` to say.
    """
    changes: dict[str, dict[str, Any]] = {}
    for text in texts:
        target, equals, value = text.partition("=")
        section, dot, name = (part.strip() for part in target.partition("."))
        if not (equals and dot and section and name):
            raise SettingsError(f"{text}: expected section.name=value, such as planner.depth=7")
        if name in changes.setdefault(section, {}):
            raise SettingsError(f"{section}.{name} is given twice")
        changes[section][name] = setting_value(value)
    return changes


def first_of(error: Exception) -> str:
    """Return the first problem that an error of a validation names; of another one its message."""
    if not isinstance(error, ValidationError):
        return str(error)
    first = error.errors(include_url=False)[0]
    return f"{'.'.join(map(str, first['loc']))}: {first['msg']}"


def _refusal(section: type[_Validated], problem: ErrorDetails) -> str:
    """Say which value is refused, and what is allowed instead."""
    name = section.section()
    why = _WANTED.get(problem["type"], problem["msg"])
    why = why.removeprefix("Value error, ").replace("Input should be", "must be")
    if not problem["loc"]:
        return f"{name}.{why}"
    setting = str(problem["loc"][0])
    if problem["type"] == "extra_forbidden":
        known = did_you_mean(setting, section.model_fields)
        return f"there is no setting `{name}.{setting}`; {known}"
    return f"{name}.{setting} {why}, not {problem['input']!r}"


Probability = Annotated[float, Field(ge=0, le=1)]
"""A number from 0 to 1."""
Finite = Annotated[float, Field(allow_inf_nan=False)]
"""A number, neither infinite nor NaN."""
Nonnegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Periods = Annotated[int, Field(ge=1, le=10_000)]
Count = Annotated[int, Field(ge=0, le=COUNTED)]
PositiveCount = Annotated[int, Field(ge=1, le=COUNTED)]
Size = Annotated[int, Field(ge=1, le=SIZE)]


class PlannerSettings(Section):
    """Depth, budget and preferences of the planner."""

    name: str = "lookahead"
    """The planner: the name of an entry point in the group `serp.planners`, or a name in
    `Task.planners`. Text after a colon is passed to the planner."""
    depth: Periods = 5
    """Depth of the lookahead in control periods."""
    discount: Annotated[float, Field(gt=0, le=1)] = 0.99
    """γ: weight of a reward one control period later, for planner and learner. With a learner, γ
    must be less than 1."""
    max_nodes: PositiveCount = 10_000
    """Largest number of expanded nodes. A layer that would exceed this budget is not expanded, and
    the plan ends at the deepest complete layer. The first layer is always expanded."""
    accepted_risk: Annotated[float, Field(ge=0, lt=1)] = 0.02
    """Probability of damage that is accepted beyond the least possible one. If the planner sees to
    the end of the task, this is the probability until the end; else that of a step, and of a path.
    A risk of 1 is never accepted. If 0, the least risk comes before any reward. These
    probabilities come from `probabilistic` effects and from adaptation."""


class AdaptationSettings(Section):
    """Online adaptation of the model by its one-step errors."""

    mode: Literal["off", "parameters", "residual", "full", "rewards"] = "off"
    """`off` only records the errors. `parameters` estimates the numbers in effects and rates.
    `residual` learns a model of the remaining one-step error. `full` does both. `rewards` does
    the same as `full`, and also corrects the file's rewards. Use `rewards` only if the file's
    rewards estimate those that the learner uses: a correction removes hints for the planner. In all
    modes but `off`, the planner prefers safe actions that were tried fewer than 4 times."""

    @property
    def residual(self) -> bool:
        """Whether a residual is learned."""
        return self.mode in ("residual", "full", "rewards")

    @property
    def parameters(self) -> bool:
        """Whether parameters of the file are estimated."""
        return self.mode in ("parameters", "full", "rewards")


class ArbiterSettings(Section):
    """Which of planner and learner acts, and which actions are vetoed."""

    rho: Probability = 0.0
    """Initial learner probability ρ."""
    rho_increment: Probability = 0.01
    """Δρ: increase of ρ at the end of each episode."""
    r_min: Finite | None = None
    """R_min: a proposal with a smaller predicted reward is vetoed. None: there is no such veto."""
    veto_horizon: Literal["step", "lookahead"] = "lookahead"
    """`step` vetoes actions whose next step is unsafe. `lookahead` also vetoes actions after which
    every path is unsafe within the lookahead, if another action has a safe path. After a lookahead
    failure, an action must also leave two safe continuations beyond the lookahead, if another
    action does. After too many failures, `lookahead` vetoes as `step` does."""
    unmodelled: Literal["allow", "veto"] = "allow"
    """Whether environment actions that the domain does not mention are allowed or vetoed."""


class GuideSettings(Section):
    """How planner and learner share the decisions. Vetoes apply under every strategy."""

    strategy: str = "mixture"
    """The strategy: the name of an entry point in the group `serp.strategies`. `mixture` is
    Algorithm 1, with the learner probability ρ of section `arbiter`."""


class LearnerSettings(Section):
    """The learner, a DQN.

    The defaults are a recipe that works on small control tasks. The preset `paper` has the
    learner of the paper's section 4.
    """

    name: str = "dqn"
    """The learner: the name of an entry point in the group `serp.learners`."""
    hidden: tuple[Size, ...] = (64, 64)
    """Neurons of each hidden layer. Without hidden layers, Q is linear in the input."""
    layer_norm: bool = False
    """LayerNorm (arXiv 1607.06450) in every hidden layer, before its ReLU."""
    members: Size = 1
    """Number of networks in the ensemble. Each learns from its own batches; Q is their mean."""
    learning_rate: Positive = 0.001
    """Step size of Adam."""
    batch_size: Size = 64
    """Samples in one gradient update of one network."""
    updates_per_step: Nonnegative = 1.0
    """Gradient updates per env step; 0.5 means one update in every second step."""
    target_polyak: Annotated[float, Field(gt=0, le=1)] | None = 0.005
    """Fraction by which the target network moves towards the network after every gradient update.
    The network chooses the next action, and the target network estimates its value (double DQN,
    arXiv 1509.06461). The norm of a gradient is clipped to 10. None: the paper's equation 3,
    without target network and clipping."""
    n_step: Periods = 3
    """n of n-step returns: number of rewards before the estimated value of a later state."""
    epsilon_end: Probability = 0.05
    """Probability of exploration from env step `epsilon_steps` on."""
    epsilon_steps: Count = 4000
    """Env steps over which the probability of exploration falls linearly from 1 to `epsilon_end`.
    For a learner that imitates the planner (strategy `evidence`), it falls from 0.1."""
    buffer_size: Annotated[int, Field(ge=1, le=10**14)] = 50_000
    """Size of the replay buffer in samples; a full buffer overwrites its oldest sample."""
    learning_starts: Count = 200
    """Env steps before the first gradient update."""


class TrainingSettings(Section):
    """Settings of the training loop."""

    reward: Literal["task", "domain", "environment", "sum"] = "task"
    """The reward that the learner learns from: the reward declared by the `task` (`Task.reward`),
    the reward of the `domain` file or of the `environment`, or the `sum` of these two. The planner
    always uses the rewards of the domain file."""
    num_envs: Annotated[int, Field(ge=1, le=1024)] = 1
    """Number of environments that are stepped at the same time. Several environments run in their
    own processes and share learner, model and budget. Such a run is saved and stopped only while
    no episode is running in any of them."""
    random_steps: Count = 0
    """Size of D₀ in env steps. Before Algorithm 1 starts, actions are drawn uniformly (with
    vetoes), and the learner is pretrained on these steps with as many gradient updates."""
    env_steps: PositiveCount = 20_000
    """Default budget of a training run, in env steps."""
    episode_steps: PositiveCount = 10_000
    """Steps after which an episode is truncated if the environment does not end it. Runs are saved
    and stopped only between episodes."""


Changes = Mapping[str, Mapping[str, Any]]
"""Section → setting → value."""


class Settings(_Validated):
    """All settings, by section; immutable.

    `serp.Settings()` has the defaults; `serp.Settings(planner=PlannerSettings(depth=3))`
    differs in one of them.

    Raises:
        SettingsError: A section is unknown or not of its class.
    """

    planner: PlannerSettings = Field(default_factory=PlannerSettings)
    adaptation: AdaptationSettings = Field(default_factory=AdaptationSettings)
    arbiter: ArbiterSettings = Field(default_factory=ArbiterSettings)
    guide: GuideSettings = Field(default_factory=GuideSettings)
    learner: LearnerSettings = Field(default_factory=LearnerSettings)
    training: TrainingSettings = Field(default_factory=TrainingSettings)

    def replace(self, changes: Changes) -> Settings:
        """Return the settings with changes.

        Raises:
            SettingsError: `changes` is not such a mapping, a section or setting does not exist,
                or a value is out of range.
        """
        sections: dict[str, Section] = {}
        for name, values in entries(changes, "settings", '{"planner": {"depth": 5}}'):
            if name not in Settings.model_fields:
                known = did_you_mean(str(name), Settings.model_fields)
                raise SettingsError(f"there is no section `{name}`; {known}")
            section: Section = getattr(self, name)
            changed = entries(values, f"settings: section `{name}`", '{"name": "..."}')
            sections[name] = section.replace(**{str(key): value for key, value in changed})
        return self.model_copy(update=sections)

    def as_dict(self) -> dict[str, dict[str, Any]]:
        """Return section → setting → JSON value (tuples as lists)."""
        return {name: section.as_dict() for name, section in self}


def entries(value: Any, what: str, example: str) -> ItemsView[Any, Any]:
    """Return the items of a mapping; anything else is a `SettingsError`."""
    if not isinstance(value, Mapping):
        raise SettingsError(f"{what} must be a mapping such as {example}, not {value!r}")
    return value.items()


ABOUT_PRESETS: Final = {
    "default": "the settings that give the best results",
    "paper": "Algorithm 1 and section 4 of the paper to the letter",
}
PRESETS: Final[Mapping[str, Changes]] = {
    # Where the paper leaves a choice open, the simplest one: vetoes by the next step, no filter, no
    # target network.
    "paper": {
        "planner": {"discount": 0.9},
        "arbiter": {"rho": 0.0, "rho_increment": 0.01, "veto_horizon": "step"},
        "learner": {
            "learning_rate": 1e-3,
            "epsilon_end": 0.3,
            "epsilon_steps": 0,
            "n_step": 1,
            "target_polyak": None,
            # D keeps every sample: up to 1,000 episodes of 500 steps.
            "buffer_size": 500_000,
        },
        "training": {"random_steps": 500},
    },
    "default": {
        "planner": {"name": "far-sight"},
        "adaptation": {"mode": "full"},
        "guide": {"strategy": "evidence"},
        "learner": {
            "members": 3,
            "layer_norm": True,
            "batch_size": 32,
            "epsilon_end": 0.02,
            "epsilon_steps": 3000,
        },
    },
}


def resolve(
    preset: str = "default",
    task_settings: Mapping[str, Changes] | None = None,
    changes: Changes | None = None,
) -> Settings:
    """Return the settings of a preset, changed by the task and then by the caller.

    Raises:
        SettingsError: The preset or a setting does not exist, or a value is out of range.
    """
    if not isinstance(preset, str) or preset not in PRESETS:
        raise SettingsError(f"there is no preset `{preset}`; {did_you_mean(str(preset), PRESETS)}")
    of_task = {} if task_settings is None else task_settings
    for key, _ in entries(of_task, "the task's settings", '{"*": {"planner": {"depth": 5}}}'):
        if key != "*" and key not in PRESETS:
            advice = did_you_mean(str(key), ["*", *PRESETS])
            if key in Settings.model_fields:
                advice = f'write settings for all presets as {{"*": {{{key!r}: ...}}}}'
            raise SettingsError(
                f"the task changes settings of preset `{key}`, which does not exist; {advice}"
            )
    settings = Settings().replace(PRESETS[preset])
    for key in ("*", preset):
        settings = settings.replace(of_task.get(key, {}))
    return settings.replace({} if changes is None else changes)
