"""What is kept of every env step, in one compiled call: each call from Python has its price."""

from __future__ import annotations

from serp.compilation import cached_njit
from serp.correction.experience import store
from serp.correction.kernels import foresee
from serp.correction.monitor import accumulate
from serp.correction.skill import follow
from serp.domain.flags import APPLICABLE
from serp.domain.native import call_step, pointer_to

# mypy: disable-error-code="no-untyped-def, untyped-decorator, no-any-return"


@cached_njit(nogil=True)
def keep(state, action, next_state, ended, written, corrected, head, states, actions, next_states,
         endings, row, table, cases, about, steps, means):  # fmt: skip
    """Record a step, and compare it with what was predicted.

    `written` and `corrected` are `[F]`, predicted by the file and by the model in use. Of the rest,
    `store` takes state to `ended` and head to `endings`, `accumulate` row to `about`, and `follow`
    the last two.

    Returns:
        Whether it was added to the tables of the monitor, and to the means of the skill.
    """
    store(state, action, next_state, ended, head, states, actions, next_states, endings)
    compared = accumulate(state, written, corrected, next_state, row, table, cases, about)
    return compared, follow(state, corrected, next_state, steps, means)


@cached_njit(nogil=True)
def step_and_keep(address, theta, dt, after, tried, state, action, next_state, ended, head, states,
                  actions, next_states, endings, row, table, cases, about, steps,
                  means):  # fmt: skip
    """As `keep`, of a step that the file predicts first.

    `address` is that of its compiled transition function, `theta` and `dt` are what that reads;
    `after`, `[F + 1]`, receives what it predicts. The step is counted in `tried`, `[A]`.
    """
    width = state.shape[0]
    for f in range(width):
        after[f] = state[f]
    after[width] = 0.0
    flags = call_step(
        address, pointer_to(state, 0), action, pointer_to(theta, 0), dt, pointer_to(after, 0)
    )
    written = after[:width] if flags & APPLICABLE else state
    tried[action] += 1
    return keep(
        state, action, next_state, ended, written, written, head, states, actions, next_states,
        endings, row, table, cases, about, steps, means,
    )  # fmt: skip


@cached_njit(nogil=True)
def predict_and_keep(block, dt, rows, kinds, tried, state, action, next_state, ended, head, states,
                     actions, next_states, endings, row, table, cases, about, steps,
                     means):  # fmt: skip
    """As `keep`, of a step that is predicted first.

    `block`, `dt` and `rows` are what `foresee` takes. Of all actions with the number of this one in
    `kinds`, `[A]`, the step is counted in `tried`, `[A]`.

    Returns:
        What `keep` does, and whether effects and processes have a result.
    """
    width = state.shape[0]
    last = 3 * (width + 1)
    by_file, flow, by_model = foresee(block, action, state, dt, rows)
    written = rows[:width] if by_file & APPLICABLE else state
    corrected = rows[last : last + width] if by_model & APPLICABLE else state
    for other in range(kinds.shape[0]):
        if kinds[other] == kinds[action]:
            tried[other] += 1
    compared, followed = keep(
        state, action, next_state, ended, written, corrected, head, states, actions, next_states,
        endings, row, table, cases, about, steps, means,
    )  # fmt: skip
    return compared, followed, flow & APPLICABLE != 0
