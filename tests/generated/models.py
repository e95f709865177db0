"""Loaded random domains, states of them, and the strategies that hypothesis draws both from."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from hypothesis import strategies as st

from serp.model.domain import Domain
from serp.model.grounder import GoalValue
from serp.pddl.source import Source
from tests.generated.oracle import Oracle
from tests.generated.writer import FULL, Texts, write_texts

DOMAIN_FILE = "generated.pddl"
PROBLEM_FILE = "generated-problem.pddl"
# So many ground schemas at most: a random domain of the writer has at most a few dozen.
LIMIT = 1_000


def load_texts(texts, *, observed=False, limit=LIMIT):
    """Load a domain from text, without files.

    Raises:
        DomainError: As `serp.model.domain.load_domain`.
    """
    source = Source(DOMAIN_FILE, texts.domain)
    problem = Source(PROBLEM_FILE, texts.problem) if texts.problem is not None else None
    return Domain.parse(source, problem, observed=observed, max_ground_schemas=limit)


@dataclass(frozen=True)
class Generated:
    """A random domain, loaded."""

    texts: Texts
    domain: Domain

    @property
    def model(self):
        """The compiled domain."""
        return self.domain.model

    @cached_property
    def oracle(self):
        """The same domain, read by the book."""
        ground, theta = self.model.ground, self.model.theta.tolist()
        worth = GoalValue(ground) if ground.goal_parameter is not None else None
        return Oracle(
            self.domain.syntax,
            self.domain.problem_syntax,
            lambda dt: 1.0 if worth is None else worth.value(theta, dt),
        )

    def spelled(self, state):
        """A state of the model as the oracle has it, with what is static besides."""
        return self._stated | {
            key: float(v) if numeric else bool(v)
            for (key, numeric), v in zip(self._keys, state.tolist(), strict=True)
        }

    @cached_property
    def _stated(self):
        return self.oracle.initial()

    @cached_property
    def _keys(self):
        return [(fluent.key, fluent.numeric) for fluent in self.model.fluents]

    def __repr__(self):
        return f"<generated domain\n{self.texts}>"


def generate(random, rewarding=FULL, *, observed=False):
    """Return a random domain, loaded. The same random state gives the same domain."""
    texts = write_texts(random, rewarding)
    return Generated(texts, load_texts(texts, observed=observed))


def random_states(random, model, count, *, exact=False):
    """Return random states `[count, F]`: quarters, parameters, and, unless exact, any number."""
    written = [p.value for p in model.parameters] or [0.0]

    def draw(numeric):
        if not numeric:
            return float(random.randint(0, 1))
        kind = random.randint(0, 9)
        if kind <= 5 or exact:
            return random.randint(-12, 12) / 4
        if kind <= 7:
            return random.choice(written)
        if kind == 8:
            return random.uniform(-100.0, 100.0)
        return random.choice((-0.0, 1e-310, -1e200, 1e308, 0.1, 1 / 3))

    rows = [[draw(fluent.numeric) for fluent in model.fluents] for _ in range(count)]
    return np.array(rows, dtype=np.float64).reshape(count, len(model.fluents))


# hypothesis ------------------------------------------------------------------------------------


@st.composite
def models_with_states(draw, rewarding=FULL, *, count=8):
    """Random domains with `count` states of theirs, `[count, F]`."""
    random = draw(st.randoms(use_true_random=False))
    generated = generate(random, rewarding, observed=draw(st.booleans()))
    return generated, random_states(random, generated.model, count)
