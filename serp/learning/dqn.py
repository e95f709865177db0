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

from serp.errors import RunError
from serp.learning import kernels
from serp.learning.adam import Adam
from serp.learning.bounds import ReturnBounds
from serp.learning.network import MeanOfImages, QNetwork, Workspace, type_F32
from serp.learning.replay import ReplayBuffer
from serp.learning.schedule import LinearSchedule
from serp.learning.settings import DQNSettings
from serp.learning.symmetry import SymmetryGroup


class Proposal(NamedTuple):
    """What the learner would do.

    Attributes:
        action: index of the action.
        exploratory: it was drawn at random.
        q: Q-values ``[A]`` behind a greedy choice; None where it was drawn at random.
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

    Attributes:
        symmetry: those in use; None where there are none.
    """

    def __init__(
        self,
        input_size: int,
        action_count: int,
        settings: DQNSettings,
        seed: np.random.SeedSequence | int,
        symmetry: SymmetryGroup | None = None,
    ) -> None:
        self.symmetry = symmetry if settings.symmetry and symmetry and len(symmetry) > 1 else None
        self.input_size = input_size
        self.action_count = action_count
        self.settings = settings
        start_rng, sample_rng, self._explore_rng = _generators(seed)

        self._online = QNetwork(
            input_size,
            action_count,
            settings.hidden,
            layer_norm=settings.layer_norm,
            members=settings.members,
            rng=start_rng,
        )
        # Without a target network the network itself values the next state (paper, equation 3).
        self._target = self._online
        if settings.has_target:
            self._target = QNetwork(
                input_size,
                action_count,
                settings.hidden,
                layer_norm=settings.layer_norm,
                members=settings.members,
            )
            self._target.copy_from(self._online)
        self._optimizer = Adam(
            self._online.parameters,
            self._online.gradient,
            settings.learning_rate,
            settings.gradient_clip,
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
        )
        self._bounds = ReturnBounds(settings.discount)
        self._epsilon = LinearSchedule(
            settings.epsilon_start, settings.epsilon_end, settings.epsilon_steps
        )
        self._env_steps = 0
        self._learn_calls = 0
        self._updates = 0

        self._single = Workspace(self._online, self._rows(1))
        self._many = Workspace(self._online, 0)
        self._work = Workspace(self._online, settings.batch_size)
        self._next_work = Workspace(self._online, settings.batch_size)
        self._choice_work = Workspace(self._online, settings.batch_size)

    @property
    def env_steps(self) -> int:
        """Env steps remembered."""
        return self._env_steps

    @property
    def updates(self) -> int:
        """Gradient updates done, those of `pretrain` included."""
        return self._updates

    @property
    def epsilon(self) -> float:
        """Probability that the next proposal explores."""
        return self._epsilon(self._env_steps)

    @property
    def value_bounds(self) -> tuple[float, float]:
        """Smallest and largest possible return, in units of Q; ±inf before the first reward."""
        return self._bounds.lower, self._bounds.upper

    def q_values(self, x: npt.NDArray[np.floating]) -> type_F32:
        """Q of every action, the mean of members and mirror images.

        In units of reward × `reward_scale`.

        Args:
            x: one input ``[F]`` or a batch ``[B, F]``.

        Returns:
            ``[A]`` or ``[B, A]``, float32, the caller's own.

        Raises:
            ValueError: the input has another shape.
        """
        if x.ndim == 1:
            return self._q_of_one(x)
        if x.ndim != 2 or x.shape[1] != self.input_size:
            raise ValueError(
                f"an input must have shape ({self.input_size},) or (batch, {self.input_size}), "
                f"not {x.shape}"
            )
        if self._many.batch != self._rows(len(x)):
            self._many = Workspace(self._online, self._rows(len(x)))
        return self._mean_q(x, self._many)

    def _rows(self, inputs: int) -> int:
        """How many inputs of the network so many inputs stand for."""
        return inputs if self.symmetry is None else inputs * self.symmetry.averaged

    def _q_of_one(self, x: npt.NDArray[np.floating]) -> type_F32:
        if x.shape != (self.input_size,):
            raise ValueError(f"an input must have shape ({self.input_size},), not {x.shape}")
        q: type_F32 = self._mean_q(x[np.newaxis], self._single)[0]
        return q

    def _mean_q(self, x: npt.NDArray[np.floating], work: Workspace) -> type_F32:
        inputs = x.astype(np.float32, copy=False)
        if self.symmetry is not None:
            return self._mean_over_images(self.symmetry, inputs, work)
        q = self._online.forward(inputs, work)
        mean: type_F32 = q[0].copy() if self.settings.members == 1 else q.mean(axis=0)
        return mean

    def _mean_over_images(self, symmetry: SymmetryGroup, x: type_F32, work: Workspace) -> type_F32:
        images: type_F32 = np.empty((work.batch, self.input_size), np.float32)
        kernels.all_images(np.ascontiguousarray(x), symmetry.columns, symmetry.signs, images)
        mean: type_F32 = np.empty((len(x), self.action_count), np.float32)
        kernels.mean_over_images(self._online.forward(images, work), symmetry.actions, mean)
        return mean

    def propose(
        self, x: npt.NDArray[np.floating], explorable: npt.NDArray[np.bool_] | None = None
    ) -> Proposal:
        """ε-greedy choice.

        With probability `epsilon` one of the explorable actions, uniformly; else the action with
        the largest Q (the lowest index among equals), explorable or not.

        Args:
            x: one input ``[F]``.
            explorable: ``[A]``; None, or none True: all.

        Raises:
            ValueError: the input has another shape.
        """
        rng = self._explore_rng
        if rng.random() < self._epsilon(self._env_steps):
            if explorable is not None:
                candidates = np.flatnonzero(explorable)
                if len(candidates):
                    return Proposal(int(candidates[rng.integers(len(candidates))]), True, None)
            return Proposal(int(rng.integers(self.action_count)), True, None)
        return self.propose_greedily(x)

    def propose_greedily(self, x: npt.NDArray[np.floating]) -> Proposal:
        """The action with the largest Q for one input ``[F]``, the lowest index among equals.

        Draws nothing at random.
        """
        q = self._q_of_one(x)
        return Proposal(int(q.argmax()), False, q)

    def greedy(self, x: npt.NDArray[np.floating]) -> int:
        """The action with the largest Q for one input ``[F]``, the lowest index among equals.

        Draws nothing at random.
        """
        return int(self._q_of_one(x).argmax())

    def greedy_batch(self, x: npt.NDArray[np.floating]) -> npt.NDArray[np.int64]:
        """As `greedy`, for each of a batch of inputs ``[B, F]``: int64 ``[B]``."""
        best: npt.NDArray[np.int64] = self.q_values(x).argmax(axis=-1)
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
    ) -> None:
        """Takes one env step with the *executed* action; see `ReplayBuffer.add`."""
        scaled = float(reward) * self.settings.reward_scale
        self.replay.add(
            observation,
            action,
            scaled,
            next_observation,
            terminated,
            truncated,
            next_allowed if self.settings.mask_targets else None,
            failing,
        )
        self._bounds.observe(scaled, terminated)
        self._env_steps += 1

    def learn(self) -> float | None:
        """The gradient updates due for one env step.

        Returns:
            Mean loss over these updates, or None where none was due: before `learning_starts`,
            or with less than one update a step.
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
        """
        if not self.replay.size:
            return None
        return self._train(self.settings.pretrain_updates if updates is None else updates)

    def _train(self, updates: int) -> float | None:
        if updates <= 0:
            return None
        return sum(self._update() for _ in range(updates)) / updates

    def _update(self) -> float:
        """One gradient update; returns its loss."""
        settings = self.settings
        batch = self.replay.sample()
        next_q = self._target.forward(batch.next_observation, self._next_work)
        choice_q = next_q
        if settings.double and self._target is not self._online:
            choice_q = self._online.forward(batch.next_observation, self._choice_work)
        lower, upper = self.value_bounds if settings.clip_targets else (-math.inf, math.inf)
        q = self._online.forward(batch.observation, self._work)
        loss: float = kernels.td_gradient(
            q,
            next_q,
            choice_q,
            batch.action,
            batch.reward,
            batch.discount,
            batch.forbidden,
            np.float32(lower),
            np.float32(upper),
            settings.loss == "huber",
            self._work.q_gradient,
        )
        self._online.backward(self._work)
        self._optimizer.step()
        self._updates += 1
        self._follow()
        return loss

    def _follow(self) -> None:
        """Lets the target network follow."""
        period, polyak = self.settings.target_period, self.settings.target_polyak
        if period is not None:
            if self._updates % period == 0:
                self._target.copy_from(self._online)
        elif polyak is not None:
            self._target.move_towards(self._online, polyak)

    def module(self) -> torch.nn.Module:
        """An independent copy of the network for export, ``[batch, F]`` → ``[batch, A]``.

        An ordinary `torch.nn.Sequential`; with several members, or symmetries, a module that takes
        the mean over them.
        """
        module = self._online.module()
        if self.symmetry is None:
            return module
        used = slice(self.symmetry.averaged)
        columns, signs, actions = (
            torch.from_numpy(array[used].copy())
            for array in (self.symmetry.columns, self.symmetry.signs, self.symmetry.actions)
        )
        return MeanOfImages(module, columns, signs, actions)

    def state_dict(self) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]:
        """Everything the future depends on: arrays and plain JSON values."""
        replay_arrays, replay_meta = self.replay.state_dict()
        arrays: dict[str, npt.NDArray[Any]] = {
            name: array.copy() for name, array in self._trained().items()
        }
        arrays |= {f"replay.{name}": array for name, array in replay_arrays.items()}
        meta = {
            "env_steps": self._env_steps,
            "learn_calls": self._learn_calls,
            "updates": self._updates,
            "adam_steps": self._optimizer.steps,
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
        trained = self._trained()
        for name, array in trained.items():
            shape = arrays[name].shape if name in arrays else "absent"
            if shape != array.shape:
                raise RunError(
                    f"the saved learner does not fit: {name} is {shape}, expected {array.shape}; "
                    "continue with the task and the settings it was saved with"
                )
        if "target" in arrays and "target" not in trained:
            raise RunError(
                "the saved learner has a target network, this one has none; continue with the "
                "settings it was saved with"
            )
        prefix = "replay."
        replay = {k.removeprefix(prefix): a for k, a in arrays.items() if k.startswith(prefix)}
        self.replay.load_state_dict(replay, meta["replay"])
        for name, array in trained.items():
            array[...] = arrays[name]
        self._env_steps = int(meta["env_steps"])
        self._learn_calls = int(meta["learn_calls"])
        self._updates = int(meta["updates"])
        self._optimizer.steps = int(meta["adam_steps"])
        self._bounds.load_state(meta["seen_rewards"])
        self._explore_rng.bit_generator.state = meta["explore_rng"]

    def _trained(self) -> dict[str, type_F32]:
        arrays: dict[str, type_F32] = {
            "parameters": self._online.parameters.numpy(),
            "adam_first": self._optimizer.first,
            "adam_second": self._optimizer.second,
        }
        if self._target is not self._online:
            arrays["target"] = self._target.parameters.numpy()
        return arrays


def _generators(seed: np.random.SeedSequence | int) -> list[np.random.Generator]:
    """Independent generators for the network's start, sampling and exploration."""
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # spawn() would count in the caller's sequence, and another call would give other children.
    own = np.random.SeedSequence([int(word) for word in sequence.generate_state(4)])
    return [np.random.default_rng(child) for child in own.spawn(3)]
