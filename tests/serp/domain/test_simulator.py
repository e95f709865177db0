"""The model against unified-planning's simulator, on random domains that both support.

Literals and states are quarters and divisors powers of two, so float64 holds every result exactly.
"""

from __future__ import annotations

from fractions import Fraction
from random import Random

import pytest
from unified_planning.exceptions import UPException

from tests.generated import SIMULATED, generate, random_states
from tests.serp.domain.simulator import Simulator, in_fractions, read


@pytest.mark.parametrize("block", range(8))
def test_model_agrees_with_unified_planning(block: int) -> None:
    compared = applicable = 0
    for seed in range(block * 8, block * 8 + 8):
        random = Random(5000 + seed)
        generated = generate(random, SIMULATED)
        model = generated.model
        try:
            simulator = Simulator(read(generated.texts))
        except UPException as refused:  # it refuses some contradictions before any state is known
            assert "effect" in str(refused) or "Effect" in str(refused), refused
            continue
        static = {tuple(k.split()): v for k, v in model.ground.static.items()}
        rest = {
            key: (bool(value) if isinstance(value, bool) else Fraction(value))
            for key, value in simulator.initial().items()
        }
        assert {k: rest[k] for k in static} == static
        for state in random_states(random, model, 3, exact=True):
            before = rest | in_fractions(model, state)
            for name in generated.oracle.instances(list(generated.oracle.instances_kinds)[0]):
                pass
