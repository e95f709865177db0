"""Several seeds of one algorithm in one process: they take turns, and learn side by side."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence

from serp.comparison.algorithms import Algorithm, Changes
from serp.comparison.conditions import Conditions
from serp.comparison.records import Trial
from serp.comparison.trial import Measured, trial_in_turns
from serp.compile_time import working_time
from serp.errors import SerpError
from serp.learning.dqn import DQN
from serp.learning.side_by_side import SideBySide
from serp.task import Task
from serp.threads import one_thread
from serp.training import LearningPoints


class Turns:
    """A clock that runs while a trial has its turn.

    Args:
        clock: Seconds, monotonic.
    """

    def __init__(self, clock: Callable[[], float] = working_time) -> None:
        self._clock = clock
        self._before = 0.0
        self._begin: float | None = None

    def __call__(self) -> float:
        """Return the seconds so far."""
        return self._before + (0.0 if self._begin is None else self._clock() - self._begin)

    def begin(self) -> None:
        """A turn begins."""
        self._begin = self._clock()

    def end(self) -> None:
        """It ends."""
        self._before, self._begin = self(), None

    def share(self, seconds: float) -> None:
        """Add the trial's share of what was done for several."""
        self._before += seconds


class _Seat:
    """A trial that takes turns with others."""

    def __init__(self, trial: Trial, turns: Turns, points: LearningPoints[Measured]) -> None:
        self.trial = trial
        self.turns = turns
        self._points = points
        self.learner: DQN | None = None
        self.number = -1  # of the learner, among those that learn side by side
        self.loss: float | None = None
        self.found: Measured | Exception | None = None

    def advance(self) -> bool:
        """Go on to where it learns next; return whether there is such a place."""
        self.turns.begin()
        try:
            self.learner = self._points.send(self.loss)
        except StopIteration as end:
            self.found = end.value
        except Exception as error:
            self.found = error
        finally:
            self.turns.end()
        return self.found is None

    def close(self) -> None:
        self._points.close()


def run_together(
    trials: Sequence[Trial],
    algorithm: Algorithm,
    task: Task,
    conditions: Conditions,
    changes: Changes,
    on_progress: Callable[[Trial, int], None],
) -> Iterator[tuple[Trial, Measured | SerpError]]:
    """Train and measure several seeds of one algorithm; yield what each found, once it has ended.

    What is found is, bit for bit, what `run_trial` would find, but for the time: a trial is charged
    with its own turns and an equal share of the learning that is done for all. One that fails ends
    with its error, and the others go on.

    Args:
        trials: What they are of; they differ in their seeds alone.
        algorithm: The algorithm, no guest.
        task: The task, with the domain file of the variant.
        conditions: The equal terms.
        changes: What the user changes in the settings of all algorithms.
        on_progress: Called with a trial and its env steps so far, some times a second at most.

    Raises:
        Exception: A trial raised what is no `SerpError`, which is a bug; the others have come to
            their end before.
    """
    seats = [_seat(trial, algorithm, task, conditions, changes, on_progress) for trial in trials]
    bug: Exception | None = None
    with one_thread(), contextlib.ExitStack() as stack:
        for seat in seats:
            stack.callback(seat.close)
        learning: SideBySide | None = None
        while seats:
            for seat in seats:
                if seat.advance():
                    continue
                if isinstance(seat.found, Measured | SerpError):
                    yield seat.trial, seat.found
                else:
                    bug = bug or seat.found
            seats = [seat for seat in seats if seat.found is None]
            if seats:
                learning = learning or _side_by_side(seats)
                _learn(learning, seats)
    if bug is not None:
        raise bug


def _seat(
    trial: Trial,
    algorithm: Algorithm,
    task: Task,
    conditions: Conditions,
    changes: Changes,
    on_progress: Callable[[Trial, int], None],
) -> _Seat:
    turns = Turns()

    def tell(env_steps: int) -> None:
        on_progress(trial, env_steps)

    points = trial_in_turns(trial, algorithm, task, conditions, changes, tell, turns)
    return _Seat(trial, turns, points)


def _side_by_side(seats: Sequence[_Seat]) -> SideBySide:
    learners: list[DQN] = []
    for seat in seats:
        assert seat.learner is not None
        seat.number = len(learners)
        learners.append(seat.learner)
    return SideBySide(learners)


def _learn(learning: SideBySide, seats: Sequence[_Seat]) -> None:
    begin = working_time()
    losses = learning.learn([seat.number for seat in seats])
    share = (working_time() - begin) / len(seats)
    for seat, loss in zip(seats, losses, strict=True):
        seat.loss = loss
        seat.turns.share(share)
