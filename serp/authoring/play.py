"""A game in the world of a file: steps by hand or a planner, taken back, changed, begun again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from serp._util.numbers import seed_of
from serp.agent.causes import (
    Cause,
    causes_of,
    causes_passed,
    changes_passed,
    why_not_applicable,
)
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel, Vector
from serp.tasks.file_world import FileWorld, Happened, WorldOptions, starting


@dataclass(frozen=True)
class FluentChange:
    """A fluent that a step changed.

    Attributes:
        name: The fluent.
        before: Its value before the step.
        after: Its value after it.
        causes: What changed it, in order; the `amount` of each is by how much.
        noise: How much of the change is chance.
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
    causes = changes_passed(model, before, happened.passages)
    changes = []
    for fluent in model.fluents:
        old, new = float(before[fluent.index]), float(after[fluent.index])
        behind = causes.get(fluent.index, [])
        if old == new and not behind:
            continue
        rest = new - old - sum(cause.amount or 0.0 for cause in behind)
        changes.append(
            FluentChange(
                fluent.name,
                old if fluent.numeric else bool(old),
                new if fluent.numeric else bool(new),
                tuple(behind),
                rest if abs(rest) > 1e-9 * max(1.0, abs(old), abs(new)) else 0.0,
            )
        )
    return changes


@dataclass(frozen=True)
class Moment:
    """A moment of a game: `[F]` state after some steps with a sum of rewards.

    Attributes:
        domain: The file, with a problem that begins where this part of the game began.
        changed: Changes by hand: fluent or fact → value.
    """

    domain: Domain
    world: FileWorld
    state: Vector
    steps: int = 0
    total: float = 0.0
    over: bool = False
    changed: Mapping[str, float | bool] = field(default_factory=dict)


@dataclass(frozen=True)
class GameStep:
    """The result of a step of a game.

    Attributes:
        number: Number of the step, from 1.
        carried_out: Name of the action that took place; None for none.
        refusal: Why the chosen action is not applicable, in words of the file; empty where it is.
        total: Sum of the rewards so far.
        brought: The causes of reward, flags and end.
    """

    number: int
    chosen: str
    carried_out: str | None
    refusal: str
    reward: float
    total: float
    unsafe: bool
    over: bool
    changes: tuple[FluentChange, ...]
    brought: tuple[Cause, ...]


class Game:
    """A game in the world of a file.

    Args:
        domain: Domain and problem; where there is no `:init`, all begins at 0 or false.
        options: Disturbances of the world. Its time limit does not count here.
        dt: Control period.
        seed: Seed of the disturbances. A step that was taken back and is done again may turn out
            otherwise.

    Raises:
        DomainError: There is no action that can ever be carried out.
    """

    def __init__(
        self, domain: Domain, options: WorldOptions | None = None, *, dt: float = 1.0, seed: int = 0
    ) -> None:
        self._options = options or WorldOptions()
        self._dt = dt
        problem = domain.problem_syntax
        if problem is None or not problem.has_init:
            domain = starting(domain, {})
        world = FileWorld(domain, self._options, dt=dt)
        state, _ = world.reset(seed=seed_of(seed))
        self._past: list[Moment] = []
        self._begun = self.moment = Moment(domain, world, state)

    @property
    def model(self) -> TransitionModel:
        """The model of the file, which is the world but for disturbances."""
        return self.moment.world.model

    @property
    def values(self) -> dict[str, float | bool]:
        """Fluent → value."""
        return self.model.values(self.moment.state)

    def step(self, action: int) -> GameStep:
        """Do a ground action; where it is not applicable, the world goes on without one.

        Raises:
            SerpError: The episode is over, or the step has no result.
        """
        now, model = self.moment, self.model
        if now.over:
            raise SerpError("the episode is over; restart, or undo the last step")
        world = now.world
        world.state = now.state
        refusal = self.refusal(action)
        state, reward, over, _, info = world.step(action)
        done = world.happened.action
        steps, total = now.steps + 1, now.total + reward
        self._go(replace(now, state=state, steps=steps, total=total, over=over))
        return GameStep(
            number=self.moment.steps,
            chosen=model.actions[action].name,
            carried_out=None if done < 0 else model.actions[done].name,
            refusal=refusal,
            reward=reward,
            total=self.moment.total,
            unsafe=info["unsafe"],
            over=over,
            changes=tuple(changes_of(model, now.state, state, world.happened)),
            brought=tuple(
                causes_passed(
                    model,
                    now.state,
                    world.happened.passages,
                    world.happened.flags,
                    [*state.tolist(), reward],
                )
            ),
        )

    def refusal(self, action: int) -> str:
        """Return why a ground action is not applicable now, in words of the file; empty if it is.

        Args:
            action: Its position.
        """
        model, state = self.model, self.moment.state
        if model.step(state, action).applicable:
            return ""
        return why_not_applicable(causes_of(model, state, action))

    def set(self, values: Mapping[str, float | bool]) -> None:
        """Change the state; facts that nothing else changes, too.

        Raises:
            DomainError: There is no predicate or function of that name.
        """
        now = self.moment
        domain = starting(now.domain, {**self.values, **values})
        world = FileWorld(domain, self._options, dt=self._dt)
        state, _ = world.reset()
        world.np_random = now.world.np_random
        changed = {**now.changed, **values}
        self._go(Moment(domain, world, state, now.steps, now.total, changed=changed))

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
