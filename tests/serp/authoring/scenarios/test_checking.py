"""What scenarios expect, against the model and the planner."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from serp.authoring.scenarios.checking import Decider, run_scenarios
from serp.model.domain import load_domain
from serp.pddl.source import Source
from serp.settings import Settings
from tests.worlds import DOMAINS

CARTPOLE = load_domain(DOMAINS / "cartpole.pddl", observed=True)
SETTINGS = Settings().replace({"planner": {"name": "lookahead", "depth": 3}})


def run(text, **options):
    source = Source("cartpole.scenarios", f"scenario one\n{text}")
    decider = Decider.of_domain(source, CARTPOLE, SETTINGS, 0.02)
    (result,) = run_scenarios(source, decider)
    return result


def found(text):
    (failure,) = run(text).failures
    return failure.found


@settings(deadline=None, max_examples=30)
@given(st.lists(st.sampled_from(["push-left", "push-right"]), min_size=1, max_size=4),
       st.floats(-0.05, 0.05))  # fmt: skip
def test_after_is_what_the_model_predicts(actions, angle):
    model = CARTPOLE.model.replace(dt=0.02)
    given_state = {fluent.name: 0.0 for fluent in model.fluents} | {"pole-angle": angle}
    state, unsafe, total = model.state(given_state), False, 0.0
    for action in actions:
        step = model.step(state, action)
        state, unsafe, total = step.state, unsafe or bool(step.unsafe), total + step.reward
    values = model.values(state)
    lines = [f"(pole-angle) = {angle!r}"]
    lines += [f"after {', '.join(actions)} ({name}) is about {value!r} within 1e-12"
              for name, value in {**values, "reward": total}.items()]  # fmt: skip
    lines.append(f"after {', '.join(actions)} {'' if unsafe else 'not '}(unsafe)")
    assert run("\n".join(lines)).passed


def test_a_veto_is_what_the_arbiter_refuses_and_why():
    falling = "(pole-angle) = 0.26\n(pole-velocity) = 0.1\n"
    assert run(falling + "refuses push-left\nrefuses push-left because unsafe").passed
    assert "(unsafe)" in found(falling + "allows push-left")
    assert "another reason: proposal predicted unsafe" in found(
        falling + "refuses push-left because low reward"
    )
    assert found("allows push-left\nrefuses push-left").startswith("it is allowed, worth ")


def test_a_failure_says_what_holds_instead():
    leaning = "(pole-angle) = 0.1\n"
    told = found(leaning + "chooses push-left")
    assert (
        told.startswith("push-right is chosen, worth ")
        and "; it comes before push-left, whose return" in told
    )
    assert found("after push-left (cart-velocity) is about 0.3") == (
        "(cart-velocity) is −0.195, not about 0.3 (0.25 to 0.35)"
    )
    assert found("(pole-angle) = 0.3\nafter 3 steps (pole-angle) is about 1") == (
        "the task ends after 1 step"
    )


def test_the_planner_keeps_nothing_of_a_scenario_for_the_next_one():
    source = Source("cartpole.scenarios", "scenario one\nchooses push-right\nchooses push-left\n")
    far = Settings().replace({"planner": {"name": "far-sight"}})
    decider = Decider.of_domain(source, CARTPOLE, far, 0.02)
    planner = decider.arbiter.planner

    def kept():
        return repr(planner.state_dict())

    before = kept()
    assert not all(result.passed for result in run_scenarios(source, decider))
    assert kept() == before
    decider.chosen(np.zeros(4))
    assert kept() != before
