"""The learner of the paper (section 3.3): a DQN, with what has been found to help since.

One env step of a training loop::

    proposal = learner.propose(observation)
    ...                                     # the arbiter decides, the environment steps
    learner.remember(observation, executed, reward, next_observation, terminated, truncated)
    loss = learner.learn()

See `serp.learning.network` about threads and determinism.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch

from serp._util.numbers import FLOAT32_MAX, best_of
from serp._util.saved_state import LARGEST, Saved, nested
from serp.errors import LearningFailure, RunError
from serp.learning.guidance import Guidance, GuidedLearning
from serp.learning.loss import TDGradient
from serp.learning.mean_q import MeanQ
from serp.learning.networks import Networks
from serp.learning.replay import ReplayBuffer
from serp.learning.return_bounds import ReturnBounds
from serp.learning.samples import Samples, type_F32
from serp.learning.schedule import LinearSchedule
from serp.learning.symmetry_group import SymmetryGroup
from serp.settings import LearnerSettings


class Proposal(NamedTuple):
    """What the learner would do.

    Attributes:
        action: index of the action.
        exploratory: it was drawn at random.
        q: Q-values ``[A]`` behind a greedy choice, `base` included; None where it was drawn at
            random.
    """

    action: int
    exploratory: bool
    q: type_F32 | None


class DQN:
    """Deep Q-network (Mnih et al. 2015) on one CPU core.

    Args:
        input_size: numbers in one input, F ≥ 1.
        action_count: actions, A ≥ 1.
        settings: all choices.
        seed: equal seeds give equal bits. A `SeedSequence` is read and left as it was.
        symmetry: symmetries of inputs and actions, used where `settings.symmetry` says so.
        guided: how it learns from a guide; None, or nothing of it in use: not at all.

    Attributes:
        symmetry: those in use; None where there are none.
        guided: as given, where something of it is in use; else None. Then `remember` needs no
            guidance.
        networks: what gradient updates change.
        replay: what it remembers.

    Under residual learning every method that asks for Q takes `base`, the guide's values ``[A]`` or
    ``[B, A]`` in units of Q, which are added to the network's; None adds none.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: LearnerSettings,
        seed: np.random.SeedSequence | int,
        symmetry: SymmetryGroup | None = None,
        guided: GuidedLearning | None = None,
    ) -> None:
        self.guided = guided if guided is not None and guided.in_use else None
        self._margin_weight = 0.0 if self.guided is None else self.guided.margin_weight
        self.symmetry = symmetry if settings.symmetry and symmetry and len(symmetry) > 1 else None
        self.input_size = input_size
        self.action_count = action_count
        self.settings = settings
        start_rng, sample_rng, self._explore_rng = _generators(seed)

        self.networks = Networks(
            input_size,
            action_count,
            settings,
            start_rng,
            start_at_zero=self.guided is not None and self.guided.residual,
        )
        self.replay = ReplayBuffer(
            input_size,
            action_count,
            capacity=settings.buffer_size,
            batch_size=settings.batch_size,
            members=settings.members,
            n_step=settings.n_step,
            discount=settings.discount,
            protected_share=settings.protected_share,
            protected_early=settings.protected_early,
            protected_failing=settings.protected_failing,
            failing_window=settings.failing_window,
            rng=sample_rng,
            symmetry=self.symmetry,
            guided=self.guided is not None,
        )
        self._bounds = ReturnBounds(settings.discount)
        self._epsilon = LinearSchedule(
            settings.epsilon_start, settings.epsilon_end, settings.epsilon_steps
        )
        self._env_steps = 0
        self._learn_calls = 0

        self._mean_q = MeanQ(self.networks.online, self.symmetry)
        self._td = TDGradient(self.networks.online, self.networks.target, settings, self.guided)

    @property
    def env_steps(self) -> int:
        """Env steps remembered."""
        return self._env_steps

    @property
    def updates(self) -> int:
        """Gradient updates done, those of `pretrain` included."""
        return self.networks.updates

    @property
    def epsilon(self) -> float:
        """Probability that the next proposal explores."""
        return self._epsilon(self._env_steps)

    @property
    def value_bounds(self) -> tuple[float, float]:
        """Smallest and largest possible return, in units of Q; ±inf before the first reward."""
        return self._bounds.lower, self._bounds.upper

    @property
    def margin_weight(self) -> float:
        """Weight of imitation, ≥ 0.

        It starts as `guided` says and may be changed at any time; it is no part of the state.

        Raises:
            ValueError: set to what is negative or not finite, or above 0 for a learner that keeps
                no guidance or learns a residual.
        """
        return self._margin_weight

    @margin_weight.setter
    def margin_weight(self, weight: float) -> None:
        if not 0.0 <= weight < math.inf:
            raise ValueError(f"the weight of imitation must be a number ≥ 0, not {weight}")
        if weight > 0.0 and (self.guided is None or self.guided.residual):
            kind = "keeps no guidance" if self.guided is None else "learns a residual"
            raise ValueError(f"a learner that {kind} cannot imitate")
        self._margin_weight = float(weight)

    def q_values(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None = None
    ) -> type_F32:
        """Q of every action, the mean of members and mirror images.

        In units of reward × `reward_scale`.

        Args:
            x: one input ``[F]`` or a batch ``[B, F]``.
            base: the guide's values ``[A]`` or ``[B, A]``, added; None: none.

        Returns:
            ``[A]`` or ``[B, A]``, float32, the caller's own.

        Raises:
            ValueError: the input or `base` has another shape.
        """
        return self._mean_q.of(self.networks.online, x, base)

    def target_q(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None = None
    ) -> type_F32:
        """As `q_values`, by the target network; without one, by the network itself."""
        return self._mean_q.of(self.networks.target, x, base)

    def member_q(self, x: npt.NDArray[np.floating]) -> type_F32:
        """Q of every action in the eyes of each network: ``[members, A]`` for one input ``[F]``."""
        return self._mean_q.of_members(self.networks.online, x)

    def newest_values(self, count: int) -> tuple[type_F32, npt.NDArray[np.float64]]:
        """What the newest states remembered are worth in which the episode went on.

        Args:
            count: samples that are looked at, at most.

        Returns:
            Inputs ``[N, F]``, and the Q ``[N]`` of the best action allowed there, in units of
            reward.
        """
        newest = self.replay.newest(count)
        goes_on = newest.discount > 0.0
        inputs = newest.next_observation[goes_on]
        if not len(inputs):
            return inputs, np.zeros(0)
        q = np.where(newest.forbidden[goes_on], -np.inf, self.q_values(inputs))
        return inputs, q.max(axis=1).astype(np.float64) / self.settings.reward_scale

    def propose(
        self,
        x: npt.NDArray[np.floating],
        explorable: npt.NDArray[np.bool_] | None = None,
        base: npt.NDArray[np.floating] | None = None,
    ) -> Proposal:
        """ε-greedy choice.

        With probability `epsilon` one of the explorable actions, uniformly; else the action with
        the largest Q (the lowest index among equals), explorable or not.

        Args:
            x: one input ``[F]``.
            explorable: ``[A]``; None, or none True: all.
            base: the guide's values ``[A]``, added to Q; None: none.

        Raises:
            ValueError: the input or `base` has another shape.
        """
        rng = self._explore_rng
        if rng.random() < self._epsilon(self._env_steps):
            if explorable is not None:
                candidates = np.flatnonzero(explorable)
                if len(candidates):
                    return Proposal(int(candidates[rng.integers(len(candidates))]), True, None)
            return Proposal(int(rng.integers(self.action_count)), True, None)
        return self.propose_greedily(x, base)

    def propose_greedily(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None = None
    ) -> Proposal:
        """The action with the largest Q for one input ``[F]``, the lowest index among equals.

        Draws nothing at random.
        """
        q = self._q_of_one(x, base)
        return Proposal(best_of(q), False, q)

    def greedy(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None = None
    ) -> int:
        """The action with the largest Q for one input ``[F]``, the lowest index among equals.

        Draws nothing at random.
        """
        return best_of(self._q_of_one(x, base))

    def _q_of_one(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None
    ) -> type_F32:
        if x.ndim != 1:
            raise ValueError(f"an input must have shape ({self.input_size},), not {x.shape}")
        return self._mean_q.of(self.networks.online, x, base)

    def greedy_batch(
        self, x: npt.NDArray[np.floating], base: npt.NDArray[np.floating] | None = None
    ) -> npt.NDArray[np.int64]:
        """As `greedy`, for each of a batch of inputs ``[B, F]``: int64 ``[B]``."""
        best: npt.NDArray[np.int64] = self.q_values(x, base).argmax(axis=-1)
        return best

    def remember(
        self,
        observation: npt.NDArray[np.floating],
        action: int,
        reward: float,
        next_observation: npt.NDArray[np.floating],
        terminated: bool,
        truncated: bool,
        next_allowed: npt.NDArray[np.bool_] | None = None,
        failing: bool = False,
        guidance: Guidance | None = None,
    ) -> None:
        """Takes one env step with the *executed* action; see `ReplayBuffer.add`.

        Raises:
            LearningFailure: returns of such rewards are too large for float32.
        """
        scaled = float(reward) * self.settings.reward_scale
        largest = abs(scaled) / (1.0 - self.settings.discount)
        if not largest <= FLOAT32_MAX:
            raise LearningFailure(
                f"learner: rewards such as {reward:g} add up to a return of {largest:g} in units "
                f"of Q, more than float32 holds (up to {FLOAT32_MAX:.2g}). Give smaller rewards, "
                "or set a smaller learner.reward_scale"
            )
        self.replay.add(
            observation,
            action,
            scaled,
            next_observation,
            terminated,
            truncated,
            next_allowed if self.settings.mask_targets else None,
            failing,
            guidance,
        )
        self._bounds.observe(scaled, terminated)
        self._env_steps += 1

    def learn(self) -> float | None:
        """The gradient updates due for one env step.

        Returns:
            Mean loss over these updates, or None where none was due: before `learning_starts`,
            or with less than one update a step.

        Raises:
            LearningFailure: the loss is not finite.
        """
        if self._env_steps < self.settings.learning_starts or not self.replay.size:
            return None
        # From whole counts, so that a share such as 0.1 never drifts.
        done = int(self._learn_calls * self.settings.updates_per_step)
        self._learn_calls += 1
        return self._train(int(self._learn_calls * self.settings.updates_per_step) - done)

    def pretrain(self, updates: int | None = None) -> float | None:
        """Gradient updates on what was remembered so far (Algorithm 1, line 1).

        Args:
            updates: how many; None: `settings.pretrain_updates`.

        Returns:
            Mean loss, or None where nothing was done.

        Raises:
            LearningFailure: the loss is not finite.
        """
        if not self.replay.size:
            return None
        return self._train(self.settings.pretrain_updates if updates is None else updates)

    def _train(self, updates: int) -> float | None:
        if updates <= 0:
            return None
        with np.errstate(over="ignore", invalid="ignore"):  # the loss shows it
            return sum(self._update() for _ in range(updates)) / updates

    def _update(self) -> float:
        """One gradient update; returns its loss. Where that is not finite, nothing changes."""
        batch = self.replay.sample()
        lower, upper = self.value_bounds if self.settings.clip_targets else (-math.inf, math.inf)
        loss = self._td.gradient(batch, lower, upper, self._margin_weight)
        if not math.isfinite(loss):
            raise self._failure_of(f"the loss is {loss}", batch)
        self.networks.step()
        return loss

    def _failure_of(self, what: str, batch: Samples | None = None) -> LearningFailure:
        """Says what is not finite first: parameters before the values that they give."""
        first = self.networks.not_finite()
        if first is None and batch is not None:
            sizes = {
                "input": batch.observation,
                "next input": batch.next_observation,
                "reward": batch.reward,
            }
            if batch.guide is not None:
                sizes["value of the guide"] = batch.guide.value
            name, array = max(sizes.items(), key=lambda item: float(np.abs(item[1]).max()))
            place = np.unravel_index(int(np.abs(array).argmax()), array.shape)
            at = f" {place[-1]}" if array.ndim > batch.reward.ndim else ""
            first = (
                "a value of the network; all its parameters are finite, and the largest number "
                f"that it was given is {name}{at}: {array[place]:g}"
            )
        return LearningFailure(
            f"learner: {what} in gradient update {self.updates + 1}, env step {self._env_steps}. "
            f"Not finite is {first}. Smaller inputs or rewards, or a smaller learner.learning_rate "
            "or learner.gradient_clip, keep the numbers small"
        )

    def module(self) -> torch.nn.Module:
        """An independent copy of the network for export, ``[batch, F]`` → ``[batch, A]``.

        An ordinary `torch.nn.Sequential`; with several members, or symmetries, a module that takes
        the mean over them.
        """
        return self._mean_q.module(self.networks.online)

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Everything the future depends on: arrays and plain JSON values.

        Raises:
            LearningFailure: a parameter is not finite; there is no future.
        """
        if self.networks.not_finite() is not None:
            raise self._failure_of("a number that is to be saved is not finite")
        replay_arrays, replay_meta = self.replay.state_dict()
        arrays: dict[str, npt.NDArray[Any]] = {
            name: array.copy() for name, array in self.networks.arrays().items()
        }
        arrays |= nested("replay", replay_arrays)
        meta = {
            "env_steps": self._env_steps,
            "learn_calls": self._learn_calls,
            "updates": self.networks.updates,
            "adam_steps": self.networks.optimizer.steps,
            "seen_rewards": self._bounds.state(),
            "explore_rng": self._explore_rng.bit_generator.state,
            "replay": replay_meta,
        }
        return arrays, meta

    def load_state_dict(
        self, arrays: Mapping[str, npt.NDArray[Any]], meta: Mapping[str, Any]
    ) -> None:
        """Continues, bit for bit, from what `state_dict` returned.

        Raises:
            RunError: the state belongs to a learner of another shape, or is incomplete; this
                learner is unchanged.
        """
        saved, networks = Saved("learner", arrays, meta), self.networks
        trained = networks.arrays()
        for name, array in trained.items():
            low = 0.0 if name == "adam_second" else -LARGEST
            saved.array(name, np.float32, array.shape, low)
        if saved.has("target") and "target" not in trained:
            raise RunError(
                "the saved learner has a target network, this one has none; continue with the "
                "settings it was saved with"
            )
        env_steps, learn_calls = saved.whole("env_steps"), saved.whole("learn_calls")
        updates, adam_steps = saved.whole("updates"), saved.whole("adam_steps")
        seen_rewards = saved.reals("seen_rewards", 4, -math.inf, math.inf)
        state = saved.generator_state("explore_rng", self._explore_rng)
        self.replay.load_state_dict(*saved.part("replay"))
        for name, array in trained.items():
            array[...] = arrays[name]
        self._env_steps, self._learn_calls = env_steps, learn_calls
        networks.updates, networks.optimizer.steps = updates, adam_steps
        self._bounds.load_state(seen_rewards)
        self._explore_rng.bit_generator.state = state


def _generators(seed: np.random.SeedSequence | int) -> list[np.random.Generator]:
    """Independent generators for the network's start, sampling and exploration."""
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # spawn() would count in the caller's sequence, and another call would give other children.
    own = np.random.SeedSequence([int(word) for word in sequence.generate_state(4)])
    return [np.random.default_rng(child) for child in own.spawn(3)]
