"""The functions of a model that go through a policy's data against those that are generated."""

from __future__ import annotations

import json
import struct
from random import Random

import numpy as np

from serp.runs.controller.reading import Entry
from serp.runs.controller.rows.step import FileRows
from serp.runs.controller.step import FileStep
from serp.runs.policy_export import programs_of
from tests.generated import generate, random_states


def test_any_domain_steps_in_a_policy_as_in_serp() -> None:
    applied = 0
    for seed in range(40):
        random = Random(seed)
        model = generate(random).model
        policy = {
            "fluents": list(model.fluents),
            "ground_actions": list(model.actions),
            "dt": model.dt,
            "programs": json.loads(json.dumps(programs_of(model.ground))),
        }
        exported = FileStep(Entry(policy), model.theta.tolist())
        together = FileRows(Entry(policy), model.theta.tolist())
        states = random_states(random, model, 4)
        columns = np.ascontiguousarray(states.T)
        for action in range(len(model.actions)):
            with np.errstate(all="ignore"):
                bounds = [4 * (k > action) for k in range(len(model.actions) + 1)]
                rows, of_rows = together.step(columns, bounds)
            for k, state in enumerate(states.tolist()):
                out, flags = exported.step(state, action)
                assert of_rows[k] == flags
                if flags & 1:
                    assert rows[:, k].tobytes() == np.array(out).tobytes()
                expected, wanted = model.transition(state, action)
                assert flags == wanted
                if flags & 1:
                    applied += 1
                    assert struct.pack(f"{len(out)}d", *out) == struct.pack(
                        f"{len(out)}d", *expected
                    )
    assert applied > 100
