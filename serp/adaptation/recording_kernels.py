"""Recording of an env step in one compiled call, because each call from Python costs microseconds.

`log` is (step, ring, tables, means): the comparison and tables of `serp.sysid.monitor`, the ring of
`serp.sysid.transitions`, the means of the forecast skill. `transition` is (state, action, next
state, ending, reward), `head` its position in the ring, `row` its row in the tables, `steps` the
number of steps in the means. `visits` `[A]` counts the steps of each action.
"""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation.adapted_step import predict_all
from serp.adaptation.forecast_skill import update_means
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import call_step, pointer_to
from serp.sysid.monitor import ADAPTED, OBSERVED, WRITTEN, accumulate
from serp.sysid.transitions import OVER, store

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True)
def record(log, transition, head, row, steps):
    """Record a step whose predictions are in `log` already.

    Returns:
        Whether it was added to the tables of the monitor, and to the means of the forecast skill.
    """
    step, ring, tables, means = log
    state, _, next_state, ending, reward = transition
    width = state.shape[0]
    step[OBSERVED, :width] = next_state
    step[OBSERVED, width] = reward
    step[OBSERVED, width + 1] = 1.0 if ending == OVER else 0.0
    store(transition, head, ring)
    compared = accumulate(state, step, row, tables)
    return compared, update_means(state, step[ADAPTED], next_state, steps, means)


@cached_njit(nogil=True)
def fill_in(step, which, state, out, flags):
    """Write a prediction to a row of `step`: `out` `[F + 1]`, or no change."""
    width = state.shape[0]
    if flags & APPLICABLE:
        step[which, : width + 1] = out
        step[which, width + 1] = 1.0 if flags & TERMINAL else 0.0
    else:
        step[which, :width] = state
        step[which, width:] = 0.0


@cached_njit(nogil=True)
def record_by_file(address, theta, dt, visits, log, transition, head, row, steps):
    """Predict a step by the compiled function at an address and record it; see `record`."""
    step, state, action = log[0], transition[0], transition[1]
    width = state.shape[0]
    out = step[ADAPTED, : width + 1]
    out[:width] = state
    out[width] = 0.0
    flags = call_step(
        address, pointer_to(state, 0), action, pointer_to(theta, 0), dt, pointer_to(out, 0)
    )
    fill_in(step, WRITTEN, state, out, flags)
    step[ADAPTED] = step[WRITTEN]
    visits[action] += 1
    return record(log, transition, head, row, steps)


@cached_njit(nogil=True)
def record_adapted(buffer, dt, rows, alike, visits, log, transition, head, row, steps):
    """Predict a step by the file and the adapted model, see `predict_all`, and record it.

    `alike` `[A]` are numbers, equal for ground actions whose visits are counted together.

    Returns:
        The results of `record`, and whether effects and processes have a result.
    """
    step, state, action = log[0], transition[0], transition[1]
    width = state.shape[0]
    by_file, flow, by_model = predict_all(buffer, action, state, dt, rows)
    fill_in(step, WRITTEN, state, rows[: width + 1], by_file)
    fill_in(step, ADAPTED, state, rows[3 * (width + 1) :], by_model)
    for other in range(alike.shape[0]):
        if alike[other] == alike[action]:
            visits[other] += 1
    compared, followed = record(log, transition, head, row, steps)
    return compared, followed, flow & APPLICABLE != 0
