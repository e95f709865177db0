"""Several learners that learn side by side: one pass over the networks of all.

A gradient update of a small network costs more in calls than in arithmetic. Learners of the same
shape (the seeds of one experiment) share the calls: their parameters lie in one array, learner by
learner, and every matrix product and compiled loop goes over all of them. Each still draws from its
own memory by its own generator, and every number is, bit for bit, what it would be alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from serp.learning.dqn import DQN
from serp.learning.samples import Samples
from serp.learning.td import TDGradient


class SideBySide:
    """Does the gradient updates of several learners together.

    From then on their networks lie in its memory; everything else about a learner stays as it was:
    it may be asked, saved, restored, and updated on its own.

    Args:
        learners: of equal sizes and settings and with a guide in the same way, each once, ≥ 1.

    Raises:
        ValueError: they differ, or there are none.
    """

    def __init__(self, learners: Sequence[DQN]) -> None:
        self._learners = tuple(learners)
        _refuse_different(self._learners)
        first = self._learners[0]
        self._members, self._batch_size = first.settings.members, first.settings.batch_size
        members = len(self._learners) * self._members
        online = first.networks.online.another(members)
        target = online.another(members) if first.settings.has_target else online
        self._online, self._target = online, target
        self._batch = Samples.zeros(
            members * self._batch_size,
            first.input_size,
            first.action_count,
            guided=first.guided is not None,
        )
        for i, learner in enumerate(self._learners):
            start, stop = i * self._members, (i + 1) * self._members
            learner.networks.move_into(online.part(start, stop), target.part(start, stop))
            learner.replay.sample_into(
                self._batch.part(start * self._batch_size, stop * self._batch_size)
            )
        # How to know them again, should they be taken elsewhere.
        self._places = [learner.networks.online.parameters for learner in self._learners]
        self._runs: dict[tuple[int, int], tuple[TDGradient, Samples]] = {}

    def learn(self, numbers: Sequence[int] | None = None) -> list[float | None]:
        """As `DQN.learn`, of each learner; one with a `failure` stands still, and raises nothing.

        Args:
            numbers: which learners, each at most once; None: all.

        Returns:
            What `DQN.learn` of each would return.

        Raises:
            ValueError: a learner was put side by side with others meanwhile.
        """
        numbers = range(len(self._learners)) if numbers is None else numbers
        due = [0] * len(self._learners)
        for i in numbers:
            if self._learners[i].networks.online.parameters is not self._places[i]:
                raise ValueError("a learner now learns side by side with others; make another one")
            due[i] = self._learners[i].take_due()
        losses = [0.0] * len(self._learners)
        with np.errstate(over="ignore", invalid="ignore"):  # the losses show it
            for done in range(max(due, default=0)):
                for start, stop in _runs([updates > done for updates in due]):
                    for i, loss in enumerate(self._update(start, stop), start):
                        losses[i] += loss
        return [losses[i] / due[i] if due[i] else None for i in numbers]

    def _update(self, start: int, stop: int) -> list[float]:
        """One gradient update of the learners from `start` to `stop`; returns their losses."""
        learners = self._learners[start:stop]
        if len(learners) == 1:
            return [learners[0].update()]
        td, batch = self._run(start, stop)
        samples = [learner.replay.sample() for learner in learners]
        imitate = any(learner.margin_weight > 0.0 for learner in learners)
        td.forward(batch.observation, batch.next_observation, imitate)
        losses = [
            learner.loss(td, i, own)
            for i, (learner, own) in enumerate(zip(learners, samples, strict=True))
        ]
        td.backward()
        for learner in learners:
            learner.step()
        return losses

    def _run(self, start: int, stop: int) -> tuple[TDGradient, Samples]:
        """What passes over some neighbours, and their batch ``[members, batch]``."""
        if (start, stop) not in self._runs:
            first, end = start * self._members, stop * self._members
            online = self._online.part(first, end)
            target = online
            if self._target is not self._online:
                target = self._target.part(first, end)
            learner, size = self._learners[0], self._batch_size
            td = TDGradient(online, target, learner.settings, learner.guided, stop - start)
            batch = self._batch.part(first * size, end * size).reshaped(end - first, size)
            self._runs[start, stop] = td, batch
        return self._runs[start, stop]


def _refuse_different(learners: Sequence[DQN]) -> None:
    if not learners:
        raise ValueError("there is no learner to learn side by side")
    if len(set(map(id, learners))) < len(learners):
        raise ValueError("a learner cannot learn side by side with itself")
    first = learners[0]
    for other in learners[1:]:
        for name, one, another in (
            ("inputs", first.input_size, other.input_size),
            ("actions", first.action_count, other.action_count),
            ("settings", first.settings, other.settings),
            ("ways to learn from a guide", first.guided, other.guided),
        ):
            if one != another:
                raise ValueError(
                    f"learners side by side must have equal {name}, not {one} and {another}"
                )


def _runs(chosen: Sequence[bool]) -> Iterator[tuple[int, int]]:
    """Where neighbours are chosen: first and end of each such run."""
    start = None
    for i, yes in enumerate([*chosen, False]):
        if yes and start is None:
            start = i
        elif not yes and start is not None:
            yield start, i
            start = None
