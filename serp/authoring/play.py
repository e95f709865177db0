"""A game in the world of a file: steps by hand or a planner, taken back, changed, begun again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

from serp._util.numbers import seed_of
from serp.agent.causes import Cause, causes_of, causes_passed, changes_passed, why_not_applicable
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel, Vector
from serp.tasks.file_world import FileWorld, Happened, WorldOptions, starting


class FluentChange(NamedTuple):
    """A fluent that a step changed, and what changed it, in order, each by its `amount`.

    `noise` is how much of the change is chance.
    """

    name: str
    before: float | bool
    after: float | bool
    causes: tuple[Cause, ...]
    noise: float


def changes_of(
    model: TransitionModel, before: Vector, after: Vector, happened: Happened
) -> list[FluentChange]:
    """Return the fluents that a step changed, or that something tried to change, in their order."""
    causes = changes_passed(model, before, happened.passages())
    old, new, changes = model.values(before), model.values(after), []
    for fluent in model.fluents:
        a, b, behind = old[fluent.name], new[fluent.name], causes.get(fluent.index, [])
        if a != b or behind:
            rest = float(b) - float(a) - sum(cause.amount or 0.0 for cause in behind)
            rest = rest if abs(rest) > 1e-9 * max(1.0, abs(a), abs(b)) else 0.0
            changes.append(FluentChange(fluent.name, a, b, tuple(behind), rest))
    return changes


@dataclass(frozen=True)
class Moment:
    """A moment of a game: `[F]` state after some steps with a sum of rewards."""

    state: Vector
    steps: int = 0
    total: float = 0.0
    over: bool = False


class GameStep(NamedTuple):
    """The result of a step: the action that was chosen, and the one that took place, if any.

    `refusal` says why the chosen one is not applicable; `brought` are the causes of reward, flags
    and end.
    """

    chosen: str
    carried_out: str | None
    refusal: str
    reward: float
    changes: list[FluentChange]
    brought: list[Cause]


class Game:
    """A game in the world of a file, with disturbances by `options`, seeded by `seed`.

    Where there is no `:init`, all begins at 0 or false. A step that was taken back and is done
    again may turn out otherwise. `domain` has the problem that the game begins with; `model` is the
    world but for disturbances; `moment` is where the game is.
    """

    def __init__(
        self, domain: Domain, options: WorldOptions | None = None, *, dt: float = 1.0, seed: int = 0
    ) -> None:
        problem = domain.problem_syntax
        if problem is None or not problem.has_init:
            domain = starting(domain, {})
        self.domain = domain
        self._world = FileWorld(domain, options or WorldOptions(), dt=dt)
        self.model = self._world.model
        state, _ = self._world.reset(seed=seed_of(seed))
        self._past: list[Moment] = []
        self._begun = self.moment = Moment(state)

    @property
    def values(self) -> dict[str, float | bool]:
        """Fluent → value."""
        return self.model.values(self.moment.state)

    def step(self, action: int) -> GameStep:
        """Do a ground action; where it is not applicable, the world goes on without one.

        Raises:
            SerpError: The episode is over, or the step has no result.
        """
        now, model, world = self.moment, self.model, self._world
        if now.over:
            raise SerpError("the episode is over; restart, or undo the last step")
        refusal = self.refusal(action)
        world.state = now.state
        state, reward, over, _, _ = world.step(action)
        happened = world.happened
        self._go(Moment(state, now.steps + 1, now.total + reward, over))
        after = [*state.tolist(), reward]
        return GameStep(
            chosen=model.actions[action].name,
            carried_out=None if happened.action < 0 else model.actions[happened.action].name,
            refusal=refusal,
            reward=reward,
            changes=changes_of(model, now.state, state, happened),
            brought=[*causes_passed(model, now.state, happened.passages(), happened.flags, after)],
        )

    def refusal(self, action: int) -> str:
        """Return why a ground action, by its position, is not applicable now; empty if it is."""
        model, state = self.model, self.moment.state
        if model.step(state, action).applicable:
            return ""
        return why_not_applicable(causes_of(model, state, action))

    def set(self, values: Mapping[str, float | bool]) -> None:
        """Change fluents of the state.

        Raises:
            SerpError: A name is no fluent that can change in this world.
        """
        known = self.values
        for name in values:
            if name not in known:
                raise SerpError(
                    f"`{name}` is fixed by the problem; begin with --state {name}=..., or change "
                    "the file"
                )
        self._go(replace(self.moment, state=self.model.state({**known, **values}), over=False))

    def undo(self) -> bool:
        """Take the last step, change or restart back; return whether there was one."""
        if not self._past:
            return False
        self.moment = self._past.pop()
        return True

    def restart(self) -> None:
        """Begin again where the game began."""
        self._go(self._begun)

    def _go(self, moment: Moment) -> None:
        self._past.append(self.moment)
        self.moment = moment
