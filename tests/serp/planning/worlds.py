"""Small random domains that are worth planning in: few numbers, many ways to the same state.

Where `tests.generated` is after everything the language has, these have what planning is about:
actions that commute (so that states merge), rewards that tie, dangers that can be avoided and
dangers that cannot, ends, dead ends. Equal seeds give equal domains, loaded and compiled once.
"""

import functools
from random import Random

import numpy as np

from serp.model.learned.adapted_model import AdaptedModel
from tests.generated import Texts, load_texts
from tests.serp.model.learned import worlds as adapted

WORLDS = 20
"""Seeds from 0 on that the tests share; each costs a compilation of its own."""


def load(domain):
    """Return the model of a domain given as text."""
    return load_texts(Texts(domain, None)).model


def text_of(seed):
    """Return the random domain of a seed as text."""
    return _Writer(Random(seed)).domain()


@functools.cache
def world(seed):
    """Return the random domain of a seed, loaded."""
    return load(text_of(seed))


@functools.cache
def risky_world(seed):
    """A world whose model has counted outcomes, and in half of the cases residuals as well."""
    model, rng = AdaptedModel(world(seed)), np.random.default_rng(seed)
    if seed % 2:
        adapted.publish(model, rng, adapted.MILD)
    adapted.count(model, rng)
    return model


def states_of(model, random, count):
    """Return random states `[count, F]`, halves between -2 and 2."""
    rows = [
        [random.randint(-4, 4) / 2 if f.numeric else random.randint(0, 1) for f in model.fluents]
        for _ in range(count)
    ]
    return np.array(rows, dtype=np.float64).reshape(count, len(model.fluents))


class _Writer:
    """Writes one domain."""

    def __init__(self, random):
        self.random = random
        self.numbers = [f"f{k}" for k in range(random.randint(1, 3))]
        self.facts = [f"p{k}" for k in range(random.randint(0, 2))]
        # Rewards that are never good, or all alike, are where planners go wrong.
        # A condition of every action leaves, where it fails, nothing that could be done.
        self.everywhere = [self.condition()] if random.random() < 0.25 else []
        self.rewards = random.choice((("1", "2", "0.5"), ("-1", "-2"), ("1",), ("1", "-1", "0.25")))

    def domain(self):
        facts = " ".join(f"({name})" for name in (*self.facts, "unsafe", "terminal"))
        numbers = " ".join(f"({name})" for name in (*self.numbers, "reward"))
        parts = [self.action(k) for k in range(self.random.choice((1, 2, 3, 3, 4, 5)))]
        parts += [self.process(k) for k in range(self.random.choice((0, 1, 1)))]
        parts += [self.event(k) for k in range(self.random.randint(1, 3))]
        return (
            "(define (domain world)\n"
            f"  (:predicates {facts})\n  (:functions {numbers})\n" + "\n".join(parts) + ")\n"
        )

    def action(self, k):
        conditions = list(self.everywhere)
        if self.random.random() < 0.4:
            conditions.append(self.condition())
        changed = self.random.sample(
            self.numbers, min(len(self.numbers), self.random.choice((1, 2)))
        )
        effects = [self.change(number) for number in changed]
        if self.random.random() < 0.15:  # together with another change a contradiction
            effects.append(f"(when {self.condition()} (assign ({self.random.choice(changed)}) 0))")
        if self.facts and self.random.random() < 0.4:
            effects.append(self.toggle())
        if self.random.random() < 0.4:
            effects.append(self.reward())
        if self.random.random() < 0.3:
            flag = self.random.choice(("unsafe", "unsafe", "terminal"))
            effects.append(f"(when {self.condition()} ({flag}))")
        return (
            f"  (:action a{k} :parameters () :precondition (and {' '.join(conditions)})\n"
            f"    :effect (and {' '.join(dict.fromkeys(effects))}))"
        )

    def process(self, k):
        # What drifts by the value of another number meets its danger some steps later.
        rate = self.random.choice(("0.5", *[f"({self.random.choice(self.numbers)})"] * 3))
        condition = self.condition() if self.random.random() < 0.4 else ""
        return (
            f"  (:process flow{k} :parameters () :precondition (and {condition})\n"
            f"    :effect (and (increase ({self.random.choice(self.numbers)}) (* #t {rate}))))"
        )

    def event(self, k):
        effects = [self.reward()] if self.random.random() < 0.7 else []
        kind = self.random.random()
        if kind < 0.6:
            effects.append("(unsafe)")
        if kind < 0.2 or kind > 0.85 or not effects:
            effects.append("(terminal)")
        where = self.edge() if kind < 0.6 and self.random.random() < 0.8 else self.condition()
        return (
            f"  (:event e{k} :parameters () :precondition (and {where})\n"
            f"    :effect (and {' '.join(effects)}))"
        )

    def condition(self):
        if self.facts and self.random.random() < 0.3:
            fact = f"({self.random.choice(self.facts)})"
            return fact if self.random.random() < 0.5 else f"(not {fact})"
        operator = self.random.choice(("<", "<=", ">", ">="))
        if self.random.random() < 0.08:  # undefined at 0, where many states are
            return f"({operator} (/ 1 ({self.random.choice(self.numbers)})) 0.5)"
        return f"({operator} ({self.random.choice(self.numbers)}) {self.random.randint(-4, 4) / 2})"

    def edge(self):
        """Somewhere that most states are not, so that what is there can be avoided."""
        operator, threshold = self.random.choice(((">", 1), (">=", 2), ("<", -1), ("<=", -2)))
        return f"({operator} ({self.random.choice(self.numbers)}) {threshold})"

    def change(self, number):
        if self.random.random() < 0.15:
            return f"(assign ({number}) {self.random.randint(-2, 2)})"
        change = self.random.choice(("increase", "decrease"))
        return f"({change} ({number}) {self.random.choice((0.5, 1))})"

    def toggle(self):
        fact = f"({self.random.choice(self.facts)})"
        return fact if self.random.random() < 0.5 else f"(not {fact})"

    def reward(self):
        if self.random.random() < 0.3:
            return f"(increase (reward) ({self.random.choice(self.numbers)}))"
        return f"(increase (reward) {self.random.choice(self.rewards)})"
