"""The guarantee: nothing unsafe is executed while there is something else, whoever proposes.

`tests.test_soak` judges whole trainings by an independent reading of the file.
"""

from collections import Counter
from random import Random

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from serp._util.plugins import offered
from serp.agent.decision import Reason
from serp.agent.registry import STRATEGIES
from serp.learning.dqn import Proposal
from tests.generated.profile import examples
from tests.serp.agent.decisions import (
    MODELS,
    RISKY,
    View,
    Wild,
    action_maps,
    arbiter_of,
    proposer_of,
)
from tests.serp.planning.worlds import states_of


def every_decision(arbiter, state, seed):
    """Decide in all the ways in which a decision is executed under vetoes."""
    proposer, size = proposer_of(Wild(seed, arbiter.actions.size)), arbiter.actions.size
    with np.errstate(over="ignore", invalid="ignore"):
        return [
            arbiter.decide(state, proposer),
            arbiter.decide_greedily(state, proposer),
            arbiter.plan(state),
            *(arbiter.judge_proposal(state, Proposal(k, True)) for k in range(size)),
        ]


def test_nothing_unsafe_is_executed_while_there_is_an_alternative():
    """Under every strategy, whatever was learned of the world and of values."""
    met = Counter()

    @examples(1_000)
    @given(
        strategy=st.sampled_from(sorted(offered(STRATEGIES))),
        model=st.sampled_from((*MODELS, *RISKY)),
        actions=st.integers(0, 4),
        seed=st.integers(0, 2**32),
    )
    def holds(strategy, model, actions, seed):
        random = Random(seed)
        arbiter = arbiter_of(list(action_maps(model, random))[actions], random, strategy)
        arbiter._exploration_bonus = lambda forecast: (
            forecast._replace(choice=random.randrange(arbiter.actions.size))
            if random.random() < 0.3
            else forecast
        )
        for state in states_of(model, random, 3):
            view = View.of(arbiter, state)
            for decision in every_decision(arbiter, state, seed):
                check(decision, view, arbiter.settings.unmodelled == "allow")

    def check(decision, view, unknown_allowed):
        kinds, executed = view.kind, view.kind[decision.action]
        unknown = "unknown" in kinds and unknown_allowed
        if "safe" in kinds:
            assert executed == "safe" or (executed == "unknown" and unknown)
        elif unknown:
            assert executed in ("unknown", "risky")
        elif not {"risky", "undefined", "certain"}.isdisjoint(kinds):
            assert executed in ("risky", "undefined", "certain")
            if "risky" not in kinds and "undefined" in kinds:
                assert executed == "undefined"  # may be damage, which the others are for certain
        elif any(view.applicable):
            # Nothing is left but damage: it is done knowingly, by an action that has effects.
            assert executed == "unsafe"
        elif "not applicable" in kinds:
            assert executed == "not applicable"
        assert decision.unsafe == (executed == "unsafe")
        met[f"{executed}, {'with' if 'safe' in kinds or unknown else 'without'} alternative"] += 1
        met["refused as unsafe"] += decision.vetoed and decision.proposal_unsafe
        met["refused as too risky"] += decision.reason is Reason.TOO_RISKY

    holds()
    # The danger was there.
    assert met["unsafe, without alternative"] > 200
    assert met["not applicable, without alternative"] > 20
    assert met["safe, with alternative"] > 2_000
    assert met["unknown, with alternative"] > 200
    assert met["undefined, without alternative"] > 20
    assert met["risky, without alternative"] > 200
    assert met["refused as unsafe"] > 200
    assert met["refused as too risky"] > 40
