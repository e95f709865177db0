"""The model against unified-planning's simulator, on random domains that both support.

Literals and states are quarters and divisors powers of two, so float64 holds every result exactly.
"""

from __future__ import annotations

from random import Random

import pytest
from unified_planning.exceptions import UPConflictingEffectsException

from serp.pddl.syntax import Kind
from tests.generated import SIMULATED, generate, random_states
from tests.serp.model.simulator import Simulator, in_fractions, read


@pytest.mark.parametrize("block", range(2))
def test_model_agrees_with_unified_planning(block: int) -> None:
    compared = applicable = reached = 0
    for seed in range(block * 25, block * 25 + 25):
        random = Random(5000 + seed)
        generated = generate(random, SIMULATED)
        model = generated.model
        try:
            simulator = Simulator(read(generated.texts))
        except UPConflictingEffectsException:
            continue  # effects that contradict each other in every state; it refuses the file
        initial = simulator.initial()
        fixed = {f.name for f in simulator.problem.get_static_fluents()}
        for state in random_states(random, model, 4, exact=True):
            for fluent in model.fluents:
                if fluent.symbol in fixed:  # the simulator does not look at the state for these
                    state[fluent.index] = float(initial[(fluent.symbol, *fluent.arguments)])
            before = initial | in_fractions(model, state)
            for name in generated.oracle.instances(Kind.ACTION):
                after = simulator.step(before, name)
                known = {action.name for action in model.actions}
                found = model.step(state, name) if name in known else None
                assert (found is not None and bool(found.applicable)) == (after is not None), name
                compared += 1
                if after is None or found is None:
                    continue
                assert before | in_fractions(model, found.state) == after, name
                applicable += 1
                if model.ground.goal is not None:
                    assert found.terminal == simulator.goal_reached(after), name
                    reached += found.terminal
    assert compared > 150 and applicable > 100 and reached > 0
