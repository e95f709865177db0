"""A soak: random worlds, random settings, and every executed action judged again.

    python -m tests.benchmarks.soak [--seed 0] [--decisions 1000000] [--seconds S] [--only KIND]

A number is a world, and every 200th one each a run that is killed, a full disk and torn files
(`tests.benchmarks.knocks`); with `--only` all numbers are of that kind. A number names all that is
random in it: `--seed N --decisions 1` repeats it, and `--seed N` goes on where a soak ended.

A world is a random domain file that starts in a random state, with failures, slips and noise; or
blocks or a gripper. A training in it has a random preset, strategy, planner, kind of adaptation,
horizon of vetoes and learner. After it, its agent decides in states that are random. An independent
reading of the file as written, `tests.generated.oracle`, judges each decision: an action that it
flags may be executed only where it flags every action that has a result; what the forecast calls
flagged and applicable must be so. A training that goes on from its saved state must equal the one
that it was saved from. What fails is printed as world, settings and seed, the smallest that fails.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Any, Final

import numpy as np

from serp._util import figures
from serp._util.plugins import offered
from serp.agent.registry import STRATEGIES
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel
from serp.runs.trainer import Trainer
from serp.settings import Settings, resolve
from serp.tasks.file_world import WorldOptions, starting, world_task
from serp.tasks.task import Task
from tests.generated import (
    FULL,
    PLANNABLE,
    Generated,
    Texts,
    load_texts,
    random_states,
    write_texts,
)
from tests.generated.classical import blocks, gripper

PROBES: Final = 40
"""Random states by which a world is found to be dull."""
STEPS: Final = 600
"""Env steps of a training, at least."""
RANDOM_STATES: Final = {"lookahead": 1500, "far-sight": 150, "pyperplan": 20}
"""Planner → states in which the trained agent decides; each is a new search for all but one."""
FURTHER: Final = 2
"""Calls of `Trainer.run` that a training makes beside the one that it was saved from."""
ALL_ACTIONS: Final = 16
"""Of so many decisions one has the flags of all its actions compared."""


class Fault(Exception):
    """Something that must not happen."""


@dataclass(frozen=True)
class World:
    """All that a training is made of."""

    texts: Texts
    start: dict[str, float | bool]
    options: WorldOptions
    dt: float
    preset: str
    changes: dict[str, dict[str, Any]]
    seed: int

    def __str__(self) -> str:
        settings = [f"{s}.{k}={json.dumps(v)}" for s, own in self.changes.items()
                    for k, v in own.items()]  # fmt: skip
        return (
            f"{self.texts}\nstart {self.start}\nworld {self.options!r}, dt {self.dt}, preset "
            f"{self.preset}, seed {self.seed}\n{' '.join(settings)}"
        )

    @property
    def settings(self) -> Settings:
        """The settings of the training."""
        return resolve(self.preset, None, self.changes)

    def task(self) -> Task:
        """Return the task.

        Raises:
            SerpError: The texts do not load.
        """
        domain = starting(load_texts(self.texts), self.start)
        return world_task(domain, self.options, self.dt)


def changes_of(random: Random, *, planners: tuple[str, ...] = ()) -> dict[str, dict[str, Any]]:
    """Return random settings that train fast."""
    chance = random.choice
    learner = {
        "hidden": chance(([8], [16, 16], [])), "members": chance((1, 1, 2)), "batch_size": 8,
        "layer_norm": chance((False, True)), "n_step": chance((1, 3)), "learning_starts": 50,
        "target_polyak": chance((None, 0.01)), "epsilon_steps": chance((0, 200)),
        "updates_per_step": chance((0.3, 1.0)),
    }  # fmt: skip
    return {
        "planner": {
            "name": chance(("far-sight", "lookahead", *planners)),
            "depth": random.randint(1, 4), "max_nodes": chance((3, 200)),
            "accepted_risk": chance((0.0, 0.02, 0.3)), "discount": chance((0.8, 0.99)),
        },
        "adaptation": {"mode": chance(("off", "parameters", "residual", "full", "rewards"))},
        "arbiter": {
            "veto_horizon": chance(("step", "lookahead")), "r_min": chance((None, -1.0)),
            "rho_increment": chance((0.01, 0.2)),
        },
        "guide": {"strategy": chance(sorted(offered(STRATEGIES)))},
        "learner": learner,
        "training": {
            "random_steps": chance((0, 60)), "episode_steps": 40,
            "reward": chance(("task", "sum", "environment")),
        },
    }  # fmt: skip


def drawn(number: int) -> World | None:
    """Return the world of a number; None where no action can be executed, or mostly where dull.

    It is dull where of no state the file flags some of the possible actions only.
    """
    random = Random(number)
    symbolic = random.random() < 0.1
    if symbolic:
        texts = random.choice((blocks(random.randint(2, 4), number), gripper(random.randint(1, 3))))
    else:
        texts = write_texts(random, random.choice((FULL, PLANNABLE)))
    domain = load_texts(texts)
    states = random_states(random, domain.model, PROBES)
    dull = not any(tempting(domain.model, state) for state in states)
    if not domain.model.actions or (dull and not symbolic and random.random() < 0.9):
        return None
    start: dict[str, float | bool] = {
        f.name: random.randint(-8, 8) / 4 if f.numeric else random.random() < 0.5
        for f in domain.model.fluents
    }
    options = WorldOptions(
        failure=random.choice((0.0, 0.1)), slip=random.choice((0.0, 0.1)),
        noise=random.choice((0.0, 0.0, 0.2)), max_steps=40,
    )  # fmt: skip
    planners = ("pyperplan",) if symbolic and number % 4 == 0 else ()
    return World(
        texts, {} if symbolic else start, options, random.choice((0.5, 1.0)),
        random.choice(("default", "paper")), changes_of(random, planners=planners), number,
    )  # fmt: skip


def tempting(model: TransitionModel, state: Any) -> bool:
    """Return whether a state has flagged actions and others: where a veto matters."""
    flags = [model.transition(state.tolist(), k)[1] for k in range(len(model.actions))]
    kinds = {bool(each & UNSAFE) for each in flags if each & APPLICABLE}
    return len(kinds) == 2


class Judge:
    """Judges decisions in a domain again.

    Attributes:
        counts: What was judged: decisions, what they met, and in how many a learned model was used.
    """

    def __init__(self, domain: Domain, dt: float) -> None:
        self._world, self._dt = Generated(Texts("", None), domain), dt
        self._names = [action.name for action in self._world.model.actions]
        self._known: dict[tuple[bytes, int], tuple[bool, bool]] = {}
        self.counts: Counter[str] = Counter()

    def flags(self, state: Any, action: int) -> tuple[bool, bool]:
        """Return whether the file flags a ground action in a state, and whether it has a result."""
        key = state.tobytes(), action
        if key not in self._known:
            if len(self._known) > 100_000:
                self._known.clear()
            oracle = self._world.oracle
            prediction = oracle.step(self._world.spelled(state), self._names[action], self._dt)
            self._known[key] = prediction.unsafe and prediction.applicable, prediction.applicable
        return self._known[key]

    def __call__(self, state: Any, decision: Any, trainer: Trainer | None) -> None:
        """Judge the decision in a state.

        Raises:
            Fault: It breaks the guarantee, or its forecast does not say what the file says.
        """
        ground = decision.forecast.ground.tolist()
        executed, counts = ground[decision.action], self.counts
        written = trainer is None or trainer.agent.adaptation.model.as_written
        counts["decisions"] += 1
        counts[f"{decision.executed_by}"] += 1
        counts["veto"] += decision.vetoed
        counts["in a learned model"] += not written
        possible = decision.forecast.flags[(decision.forecast.flags & APPLICABLE) != 0] & UNSAFE
        counts["where only some are flagged"] += len(set(possible.tolist())) == 2
        if executed < 0:
            return
        safe = decision.forecast.safe
        if safe.any() and not safe[decision.action]:
            raise Fault(f"{self._names[executed]} is not safe, and another is: {decision}")
        flagged, has_result = self.flags(state, executed)
        if flagged or not has_result:
            counts["flagged"] += flagged
            if (False, True) in map(partial(self.flags, state), filter(lambda k: k >= 0, ground)):
                if flagged or (written and trainer is not None):
                    raise Fault(f"{self._names[executed]}, and another is possible: {decision}")
                counts["without a result by the file alone"] += 1
        if flagged or counts["decisions"] % ALL_ACTIONS == 0:
            for action, flags in zip(ground, decision.forecast.flags.tolist(), strict=True):
                said = bool(flags & UNSAFE), bool(flags & APPLICABLE)
                if action < 0 or flags & UNDEFINED or said == self.flags(state, action):
                    continue
                # What was learned may give a result to a step that has none by the file.
                if written or self.flags(state, action)[1]:
                    name = self._names[action]
                    raise Fault(f"{name} is forecast {said} in {state.tolist()}: {decision}")
                counts["with a result by what was learned alone"] += 1

    def during(self, trainer: Trainer) -> None:
        """Judge every step of a training from now on."""
        trainer.on_step = lambda step: self(step.state, step.decision, trainer)

    def somewhere(self, trainer: Trainer, random: Random, count: int) -> None:
        """Judge decisions of a trained agent in so many of four times as many random states."""
        agent, task = trainer.agent, trainer.task
        unseen = np.zeros(task.observation_size)
        states = random_states(random, task.model, 4 * count)
        for state in sorted(states, key=partial(tempting, task.model), reverse=True)[:count]:
            try:
                x = agent.take_in(unseen, state)[1]
            except SerpError:  # too large for the learner
                continue
            decide = random.choice((agent.decide, agent.decide_greedily))
            self(state, decide(state, x), trainer)
            self.counts["in random states"] += 1


def everything(trainer: Trainer) -> tuple[str, dict[str, bytes]]:
    """Return all that a training saves but for the time that it took."""
    arrays, meta = trainer.state_dict()
    del meta["wall_time"]
    return json.dumps(meta, sort_keys=True), {name: a.tobytes() for name, a in arrays.items()}


def copied(value: Any) -> Any:
    """Return a state as a checkpoint would restore it."""
    arrays, meta = value
    return {name: np.array(a) for name, a in arrays.items()}, json.loads(json.dumps(meta))


def soak(world: World) -> Counter[str]:
    """Train in a world and decide in random states of it; return counts.

    Raises:
        Fault: Something happened that must not.
    """
    random, counts = Random(world.seed), Counter(worlds=1)
    with world.task().bind() as bound, np.errstate(all="ignore"):
        judge = Judge(bound.domain, world.dt)
        with Trainer(bound, world.settings, world.seed) as trainer:
            judge.during(trainer)
            saved_at = random.choice((0, STEPS // 3, STEPS // 2, *[STEPS] * 9))
            try:
                while trainer.env_steps < STEPS:
                    if trainer.env_steps >= saved_at:
                        resume(world, trainer)
                        saved_at, counts["resumed"] = STEPS, 1
                    for _ in trainer.run():
                        pass
            except SerpError as error:  # such as a step without result
                counts[f"ended: {type(error).__name__}"] = 1
            judge.somewhere(trainer, random, RANDOM_STATES[world.settings.planner.name])
    return counts + judge.counts


def resume(world: World, trainer: Trainer) -> None:
    """Go on with a training beside one that has only its saved state.

    Raises:
        Fault: They differ.
    """
    with world.task().bind() as bound, Trainer(bound, world.settings, world.seed) as again:
        again.load_state_dict(*copied(trainer.state_dict()))
        for _ in range(FURTHER):
            for each in (trainer, again):
                for _ in each.run():
                    pass
        if everything(trainer) != everything(again):
            raise Fault(f"the training that goes on differs at {again.env_steps} env steps")


def shrunk(world: World) -> World:
    """Return the smallest world found to fail within a minute: forms and settings are left out."""
    until = time.monotonic() + 60

    def smaller() -> Iterator[World]:
        head, *forms = world.texts.domain.rstrip().removesuffix(")").split("\n  (:")
        for k in range(len(forms)):
            text = "\n  (:".join([head, *forms[:k], *forms[k + 1 :]]) + ")\n"
            yield dataclasses.replace(world, texts=dataclasses.replace(world.texts, domain=text))
        for section, own in world.changes.items():
            for name in own:
                less = {key: value for key, value in own.items() if key != name}
                changes = {**world.changes, section: less}
                yield dataclasses.replace(world, changes=changes)
        yield dataclasses.replace(world, options=WorldOptions(max_steps=40))

    def fails(candidate: World) -> bool:
        try:
            soak(candidate)
        except SerpError:
            return False
        except Exception:
            return True
        return False

    while time.monotonic() < until:
        found = next(filter(fails, smaller()), world)
        if found == world:
            break
        world = found
    return world


def soak_number(number: int) -> Counter[str]:
    """Soak the world of a number."""
    world = None
    try:
        world = drawn(number)
        if world is None:
            return Counter(dull=1)
        return soak(world)
    except SerpError as error:  # a world without result, or one that cannot be trained in
        return Counter({f"refused: {type(error).__name__}": 1})
    except Exception:
        if world is not None:
            print(f"number {number} fails; the smallest found:\n{shrunk(world)}", flush=True)
        raise


def main() -> int:
    """Soak numbers until there are enough decisions; print a line a minute."""
    from tests.benchmarks import knocks

    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seed", type=int, default=0, help="the first number")
    parser.add_argument("--decisions", type=int, default=1_000_000)
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("--only", choices=("worlds", *knocks.KINDS))
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    figures.render = lambda figure, kind: b""  # pictures would take longer than the trainings
    counts: Counter[str] = Counter()
    begun, shown, failed = time.monotonic(), 0.0, 0
    for number in itertools.count(given.seed):
        kind = given.only or dict(enumerate(knocks.KINDS)).get(number % 200, "worlds")
        try:
            counts += (knocks.KINDS | {"worlds": soak_number})[kind](number)
        except Exception:
            failed += 1
            print(f"number {number} ({kind}):", flush=True)
            traceback.print_exc(file=sys.stdout)
        now = time.monotonic() - begun
        over = counts["decisions"] >= given.decisions or now >= given.seconds
        if over or now > shown + 60:
            shown = now
            print(
                f"{now:.0f} s, {time.process_time():.0f} s of CPU, numbers {given.seed} to "
                f"{number}, {failed} failed: {json.dumps(dict(sorted(counts.items())))}",
                flush=True,
            )
        if over:
            return int(failed > 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
