"""What is kept of every env step, in one compiled call: each call from Python has its price."""

from __future__ import annotations

from serp._util.compilation import cached_njit
from serp.adaptation.forecast_skill import follow
from serp.adaptation.step_kernels import foresee
from serp.model.flags import APPLICABLE, TERMINAL
from serp.model.native import call_step, pointer_to
from serp.sysid.monitor import CORRECTED, OBSERVED, WRITTEN, accumulate
from serp.sysid.transitions import OVER, store

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True)
def keep(step, state, action, next_state, ending, reward, head, states, actions, next_states,
         endings, rewards, row, table, cases, about, steps, means):  # fmt: skip
    """Record a step, and compare it with what was predicted.

    `step` is the record of `serp.sysid.monitor` with both predictions; what was observed is
    filled in. Of the rest, `store` takes state to `reward` and head to `rewards`, `accumulate` row
    to `about`, and `follow` the last two.

    Returns:
        Whether it was added to the tables of the monitor, and to the means of the skill.
    """
    width = state.shape[0]
    step[OBSERVED, :width] = next_state
    step[OBSERVED, width] = reward
    step[OBSERVED, width + 1] = 1.0 if ending == OVER else 0.0
    store(state, action, next_state, ending, reward, head, states, actions, next_states, endings,
          rewards)  # fmt: skip
    compared = accumulate(state, step, row, table, cases, about)
    return compared, follow(state, step[CORRECTED], next_state, steps, means)


@cached_njit(nogil=True)
def predicted(step, which, state, out, flags):
    """Fill in a prediction: `out` `[F + 1]` with its flags, or that nothing happens."""
    width = state.shape[0]
    if flags & APPLICABLE:
        step[which, : width + 1] = out
        step[which, width + 1] = 1.0 if flags & TERMINAL else 0.0
    else:
        step[which, :width] = state
        step[which, width:] = 0.0


@cached_njit(nogil=True)
def step_and_keep(address, theta, dt, tried, step, state, action, next_state, ending, reward, head,
                  states, actions, next_states, endings, rewards, row, table, cases, about, steps,
                  means):  # fmt: skip
    """As `keep`, of a step that the file predicts first.

    `address` is that of its compiled transition function, `theta` and `dt` are what that reads. The
    step is counted in `tried`, `[A]`.
    """
    width = state.shape[0]
    out = step[CORRECTED, : width + 1]
    out[:width] = state
    out[width] = 0.0
    flags = call_step(
        address, pointer_to(state, 0), action, pointer_to(theta, 0), dt, pointer_to(out, 0)
    )
    predicted(step, WRITTEN, state, out, flags)
    step[CORRECTED] = step[WRITTEN]
    tried[action] += 1
    return keep(
        step, state, action, next_state, ending, reward, head, states, actions, next_states,
        endings, rewards, row, table, cases, about, steps, means,
    )  # fmt: skip


@cached_njit(nogil=True)
def predict_and_keep(block, dt, rows, kinds, tried, step, state, action, next_state, ending, reward,
                     head, states, actions, next_states, endings, rewards, row, table, cases, about,
                     steps, means):  # fmt: skip
    """As `keep`, of a step that is predicted first.

    `block`, `dt` and `rows` are what `foresee` takes. Of all actions with the number of this one in
    `kinds`, `[A]`, the step is counted in `tried`, `[A]`.

    Returns:
        What `keep` does, and whether effects and processes have a result.
    """
    width = state.shape[0]
    by_file, flow, by_model = foresee(block, action, state, dt, rows)
    predicted(step, WRITTEN, state, rows[: width + 1], by_file)
    predicted(step, CORRECTED, state, rows[3 * (width + 1) :], by_model)
    for other in range(kinds.shape[0]):
        if kinds[other] == kinds[action]:
            tried[other] += 1
    compared, followed = keep(
        step, state, action, next_state, ending, reward, head, states, actions, next_states,
        endings, rewards, row, table, cases, about, steps, means,
    )  # fmt: skip
    return compared, followed, flow & APPLICABLE != 0
