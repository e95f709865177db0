"""Who acts, what is refused, and the guarantee: nothing unsafe while there is something else."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Iterator
from random import Random
from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from numpy.typing import NDArray

from serp.control.arbiter import Arbiter
from serp.control.decision import Actor, Decision, Reason
from serp.control.protocols import Mask, Values
from serp.control.registry import find_strategy, strategy_names
from serp.control.strategies.mixture import Mixture
from serp.learning.dqn import Proposal
from serp.model.flags import APPLICABLE, UNDEFINED, UNSAFE
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.action_map import ActionMap
from serp.planning.forecast import SAFE
from serp.planning.lookahead import Lookahead
from serp.settings import ArbiterSettings, PlannerSettings, Settings
from tests.serp.planning.worlds import WORLDS, load, states_of, world

LEARNERS = (Actor.LEARNER, Actor.EXPLORATION)
STATES = 9


GLIDER = load(
    """
    (define (domain glider)
      (:predicates (unsafe))
      (:functions (x) (v) (reward))
      (:action coast :parameters () :precondition (and) :effect (and))
      (:action brake :parameters () :precondition (and (not (= (v) 0)))
        :effect (and (scale-down (v) 1.25)))
      (:action left :parameters () :precondition (and) :effect (and (decrease (v) 0.5)))
      (:action right :parameters () :precondition (and)
        :effect (and (increase (v) 0.5) (increase (reward) 0.5)))
      (:process glide :parameters () :precondition (and)
        :effect (and (increase (x) (* #t (v)))))
      (:event wall :parameters () :precondition (and (or (> (x) 3) (< (x) -3)))
        :effect (and (unsafe))))
    """
)
"""What is unsafe here is so some steps ahead: speed is lost slowly."""


class Proposer:
    """A learner without a network: random Q-values, and exploration as the real one does it."""

    def __init__(self, seed: int, actions: int) -> None:
        self.random = np.random.default_rng(seed)
        self.actions = actions
        self.explorable: Mask | None = None
        self.asked = False

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        self.explorable, self.asked = explorable, True
        if self.random.random() < 0.5:
            allowed = np.arange(self.actions)
            if explorable is not None and explorable.any():
                allowed = np.flatnonzero(explorable)
            return Proposal(int(self.random.choice(allowed)), True, None)
        return self.propose_greedily(among=among, base=base)

    def propose_greedily(
        self, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        q = self.target_q() if base is None else (self.target_q() + base).astype(np.float32)
        choice = q if among is None or not among.any() else np.where(among, q, -np.inf)
        return Proposal(int(choice.argmax()), False, q)

    def member_q(self) -> NDArray[np.float32]:
        return self.random.normal(size=(3, self.actions)).astype(np.float32)

    def target_q(self) -> NDArray[np.float32]:
        return self.random.normal(size=self.actions).astype(np.float32)


def action_maps(model: TransitionModel, random: Random) -> Iterator[ActionMap]:
    """One to one, with actions that the domain does not mention, permuted, and many to one."""
    names = [action.name for action in model.actions]
    count = len(names)
    yield ActionMap(model, count)
    yield ActionMap(model, count + 2)
    order = random.sample(range(count + 1), count)
    yield ActionMap(model, count + 1, dict(zip(names, order, strict=True)))
    for size in (max(1, count - 1), max(1, count // 2) + 1):
        yield ActionMap(model, size, {name: random.randrange(size) for name in names})


def settings_of(random: Random) -> ArbiterSettings:
    return ArbiterSettings(
        rho=random.choice((0.0, 0.5, 0.5, 1.0)),
        r_min=random.choice((None, None, -0.5, 0.5)),
        veto_horizon=random.choice(("step", "lookahead")),
        exploration_slack=random.choice((None, 0.0, 1.0, math.inf)),
        after_veto=random.choice(("planner", "learner")),
        unmodelled=random.choice(("allow", "veto")),
        indifferent=random.choice(("first", "learner")),
    )


@dataclasses.dataclass(frozen=True)
class View:
    """What the model predicts of every environment action, read off the model itself."""

    kind: list[str]
    reward: list[float]
    steps: list[int]
    applicable: list[bool]

    @classmethod
    def of(
        cls, model: TransitionModel, actions: ActionMap, planner: Lookahead, state: Vector
    ) -> View:
        view = cls([], [], [], [])
        safe_steps = planner.forecast(state).safe_steps.tolist()
        steps = [model.transition(state.tolist(), k) for k in range(len(model.actions))]
        flags = [flag for _, flag in steps]
        rewards = [out[-1] for out, _ in steps]
        for action in range(actions.size):
            group = [k for k, e in enumerate(actions.environment_action) if e == action]
            # Which of them the environment would carry out is not known, so the worst counts.
            possible = [k for k in group if flags[k]]
            applicable = [k for k in group if flags[k] & APPLICABLE]
            unsafe = [k for k in possible if flags[k] & UNSAFE]
            undefined = [k for k in possible if flags[k] & UNDEFINED]
            known = bool(applicable) and not [k for k in unsafe or undefined if k in undefined]
            view.kind.append(
                "unknown" if not group
                else "not applicable" if not possible
                else "unsafe" if unsafe
                else "undefined" if undefined
                else "safe"
            )  # fmt: skip
            view.applicable.append(known)
            view.reward.append(min(rewards[k] for k in applicable) if known else math.nan)
            view.steps.append(min(safe_steps[k] for k in applicable) if known else -1)
        return view

    def admissible(self, settings: ArbiterSettings) -> list[bool]:
        """Which actions pass every veto, by the words of `ArbiterSettings`."""
        somewhere_safe = any(
            steps == SAFE for kind, steps in zip(self.kind, self.steps, strict=True)
            if kind != "unknown"
        )  # fmt: skip
        allowed = []
        for kind, reward, steps in zip(self.kind, self.reward, self.steps, strict=True):
            if kind == "unknown":
                allowed.append(settings.unmodelled == "allow")
                continue
            good = kind == "safe" and (settings.r_min is None or reward >= settings.r_min)
            if settings.veto_horizon == "lookahead" and somewhere_safe:
                good = good and steps == SAFE
            allowed.append(good)
        return allowed


MODELS = [*map(world, range(WORLDS)), GLIDER]


class Case(NamedTuple):
    """A decision, and what the model predicts where it was made."""

    arbiter: Arbiter
    view: View
    state: Vector
    decision: Decision
    proposer: Proposer


def cases_of(
    model: TransitionModel, actions: ActionMap, random: Random, seed: int, strategy: str = "mixture"
) -> Iterator[Case]:
    """Decide in some states of a world, with settings of all kinds."""
    depth, repeat = random.randint(1, 3), random.choice((1, 1, 2))
    planner = Lookahead(model, PlannerSettings(depth=depth, repeat=repeat))
    settings = settings_of(random)
    made = Settings(arbiter=settings).replace({"guide": {"strategy": strategy}})
    arbiter = Arbiter(planner, actions, settings, find_strategy(strategy)(made, seed))
    proposer = Proposer(seed, actions.size)
    for state in states_of(model, random, STATES):
        proposer.asked = False
        decision = arbiter.decide(state, proposer)
        yield Case(arbiter, View.of(model, actions, planner, state), state, decision, proposer)


def every_case(choices: int) -> Iterator[Case]:
    """Decide in all worlds, with all maps of actions."""
    for seed, model in enumerate(MODELS):
        random = Random(seed)
        for number, actions in enumerate(action_maps(model, random)):
            for k in range(choices):
                yield from cases_of(model, actions, random, 1000 * seed + 100 * number + k)


def test_nothing_unsafe_is_executed_while_there_is_an_alternative() -> None:
    """The guarantee, under every strategy."""
    met: Counter[str] = Counter()

    @examples(max_examples=1_200, deadline=None, derandomize=True)
    @given(
        strategy=st.sampled_from(strategy_names()),
        world=st.integers(0, WORLDS),
        actions=st.integers(0, 4),
        seed=st.integers(0, 2**32),
    )
    def holds(strategy: str, world: int, actions: int, seed: int) -> None:
        random, model = Random(seed), MODELS[world]
        chosen = list(action_maps(model, random))[actions]
        for case in cases_of(model, chosen, random, seed, strategy):
            view, decision = case.view, case.decision
            executed = view.kind[decision.action]
            unknown = "unknown" in view.kind and case.arbiter.settings.unmodelled == "allow"
            alternative = "safe" in view.kind or unknown
            met[f"{executed}, {'with' if alternative else 'without'} alternative"] += 1
            if alternative:
                assert executed not in ("unsafe", "undefined", "not applicable")
            elif "undefined" in view.kind:
                assert executed == "undefined"  # may be damage, which the others are for certain
            elif any(view.applicable):
                # Nothing is left but damage: it is done knowingly, by an action that has effects.
                assert executed == "unsafe"
            elif "not applicable" in view.kind:
                assert executed == "not applicable"
            if executed == "unknown":
                assert unknown or set(view.kind) == {"unknown"}
            assert decision.unsafe == (executed == "unsafe")
            met["proposal unsafe"] += decision.proposal_unsafe and decision.vetoed

    holds()
    # The danger was there.
    assert met["unsafe, without alternative"] > 500
    assert met["not applicable, without alternative"] > 50
    assert met["safe, with alternative"] > 5_000
    assert met["unknown, with alternative"] > 500
    assert met["undefined, without alternative"] > 50
    assert met["proposal unsafe"] > 500


def test_the_record_tells_what_happened() -> None:
    reasons: Counter[Reason] = Counter()

    for arbiter, view, _, decision, _ in every_case(9):
        reasons[decision.reason] += 1
        settings = arbiter.settings
        assert decision.rho == arbiter.rho == settings.rho
        assert decision.admissible.tolist() == view.admissible(settings)
        assert decision.admissible.dtype == np.bool_
        if view.applicable[decision.action]:
            assert decision.predicted_reward == view.reward[decision.action]
        else:
            assert math.isnan(decision.predicted_reward)
        proposed = "none" if decision.proposed < 0 else view.kind[decision.proposed]
        assert decision.proposal_unsafe == (proposed == "unsafe")
        if decision.proposed_by is Actor.PLANNER:
            assert settings.rho < 1.0
            assert decision.reason in (
                Reason.PLANNER_TURN,
                Reason.NO_SAFE_ACTION,
                Reason.NO_APPLICABLE_ACTION,
            )
            assert not decision.vetoed
            if decision.reason is Reason.PLANNER_TURN:
                assert decision.action == decision.proposed
        else:
            assert settings.rho > 0.0 or decision.forecast.indifferent
            assert decision.vetoed != (decision.reason is Reason.ACCEPTED)
            assert bool(decision.admissible[decision.proposed]) != decision.vetoed
            if decision.reason is Reason.ACCEPTED:
                assert decision.executed_by is decision.proposed_by
                assert decision.action == decision.proposed
            elif decision.executed_by in LEARNERS:
                assert settings.after_veto == "learner"
                assert decision.executed_by is decision.proposed_by is Actor.LEARNER
                assert decision.admissible[decision.action]
            else:
                assert (
                    settings.after_veto == "planner"
                    or decision.proposed_by is Actor.EXPLORATION
                    or not decision.admissible.any()
                )
        match decision.reason:
            case Reason.NOT_APPLICABLE:
                assert proposed == "not applicable"
            case Reason.UNSAFE:
                assert proposed == "unsafe"
            case Reason.UNDEFINED:
                assert proposed == "undefined"
            case Reason.LOW_REWARD:
                assert settings.r_min is not None
                assert proposed == "safe"
                assert view.reward[decision.proposed] < settings.r_min
            case Reason.UNSAFE_AHEAD:
                assert settings.veto_horizon == "lookahead"
                assert proposed == "safe"
                assert view.steps[decision.proposed] < SAFE
            case Reason.UNMODELLED:
                assert settings.unmodelled == "veto"
                assert proposed == "unknown"
            case Reason.NO_SAFE_ACTION:
                assert "safe" not in view.kind
                assert "unsafe" in view.kind
            case Reason.NO_APPLICABLE_ACTION:
                assert not any(view.applicable)
                assert decision.executed_by is Actor.FALLBACK
        if decision.executed_by is Actor.PLANNER:
            assert view.applicable[decision.action]

    # What a model that does not correct itself predicts is certain: no risk is between.
    assert set(reasons) == set(Reason) - {Reason.LITTLE_TRIED, Reason.TOO_RISKY, Reason.LEAST_RISK}
    assert min(reasons.values()) >= 5


def test_what_is_wrong_with_a_proposal_is_said_in_the_words_of_the_file() -> None:
    said: Counter[Reason] = Counter()

    for arbiter, view, state, decision, _ in every_case(4):
        explanation = arbiter.explain(decision, state)
        fine = decision.reason in (Reason.PLANNER_TURN, Reason.ACCEPTED)
        assert (explanation == "") == fine
        if fine:
            continue
        said[decision.reason] += 1
        shown = decision.proposed if decision.proposed >= 0 else decision.action
        match view.kind[shown]:
            case "unknown":
                assert "domain does not mention" in explanation
                continue
            case "not applicable":
                assert "does not hold" in explanation
            case _ if not view.applicable[shown]:
                assert any(
                    text in explanation
                    for text in ("contradicts another", "neither true nor false", "no finite")
                )
            case "unsafe":
                assert "(unsafe)" in explanation
            case "safe" if decision.reason is Reason.LOW_REWARD:
                assert f"below R_min {arbiter.settings.r_min:g}" in explanation
                continue
            case "safe":
                assert "then nothing is left that is predicted safe" in explanation
                continue
        found = re.search(r"`(.+)` \(line (\d+)\)", explanation)
        assert found is not None, explanation
        source = next(a for a in arbiter.model.actions).place.source.text
        assert found[1] in source.splitlines()[int(found[2]) - 1]
        names = [arbiter.model.actions[k].name for k in range(len(arbiter.model.actions))]
        assert explanation.split(":")[0] in names

    unsaid = {Reason.PLANNER_TURN, Reason.LITTLE_TRIED, Reason.ACCEPTED}
    assert set(said) == set(Reason) - unsaid - {Reason.TOO_RISKY, Reason.LEAST_RISK}


def test_exploration_is_kept_among_the_admissible() -> None:
    masks = 0

    for arbiter, _, _, decision, proposer in every_case(6):
        if not proposer.asked:
            continue
        mask = proposer.explorable
        slack = arbiter.settings.exploration_slack
        if slack is None:
            assert mask is None
            continue
        assert mask is not None
        assert not (mask & ~decision.admissible).any()
        assert mask.any() == decision.admissible.any()
        if decision.proposed_by is Actor.EXPLORATION and mask.any():
            assert decision.reason is Reason.ACCEPTED
        value, known = decision.forecast.value, arbiter.actions.modelled
        if (decision.admissible & known).any():
            best = value[decision.admissible & known].max()
            for action in np.flatnonzero(decision.admissible & known):
                assert mask[action] == (value[action] >= best - slack)
                masks += 1

    assert masks > 1_500


# Algorithm 1 ------------------------------------------------------------------------------------

TWO = load(
    """
    (define (domain two)
      (:predicates (unsafe))
      (:functions (x) (reward))
      (:action good :parameters () :precondition (and)
        :effect (and (increase (reward) 1)))
      (:action bad :parameters () :precondition (and)
        :effect (and (increase (reward) 0))))
    """
)
STATE = np.array([0.0])[: len(TWO.fluents)]


def two(**settings: object) -> Arbiter:
    """An arbiter whose planner always wants action 0."""
    chosen = ArbiterSettings(**settings)  # type: ignore[arg-type]
    planner = Lookahead(TWO, PlannerSettings(depth=2))
    return Arbiter(planner, ActionMap(TWO, 2), chosen, Mixture(Settings(arbiter=chosen), 7))


class Stubborn:
    """A learner that always proposes the same, with no values behind it."""

    def __init__(self, proposal: Proposal) -> None:
        self.proposal = proposal

    def propose(
        self, explorable: Mask | None, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        return self.proposal

    def propose_greedily(
        self, *, among: Mask | None = None, base: Values | None = None
    ) -> Proposal:
        return self.proposal

    def member_q(self) -> Values:
        raise AssertionError("Algorithm 1 asks for no values")

    def target_q(self) -> Values:
        raise AssertionError("Algorithm 1 asks for no values")


def propose(action: int, *, exploratory: bool = False) -> Stubborn:
    return Stubborn(Proposal(action, exploratory, None))


def test_a_proposal_below_r_min_is_refused_and_the_planner_acts() -> None:
    decision = two(rho=1.0, r_min=0.5).decide(STATE, propose(1, exploratory=True))
    assert decision.reason is Reason.LOW_REWARD
    assert decision.proposed_by is Actor.EXPLORATION
    assert (decision.proposed, decision.action) == (1, 0)
    assert decision.executed_by is Actor.PLANNER
    assert two(rho=1.0, r_min=0.0).decide(STATE, propose(1)).reason is Reason.ACCEPTED


def test_what_cannot_be_stopped_any_more_is_refused_ahead_of_time() -> None:
    state = GLIDER.state({"x": 1.0, "v": 1.5})
    right = GLIDER.action_index("right")

    def judged(horizon: str, depth: int) -> tuple[Decision, str]:
        arbiter = Arbiter(
            Lookahead(GLIDER, PlannerSettings(depth=depth)),
            ActionMap(GLIDER, 4),
            ArbiterSettings(veto_horizon=horizon),  # type: ignore[arg-type]
        )
        decision = arbiter.judge_proposal(state, Proposal(right, False, None))
        return decision, arbiter.explain(decision, state)

    decision, explanation = judged("lookahead", 3)
    assert decision.reason is Reason.UNSAFE_AHEAD
    assert decision.action == GLIDER.action_index("left")
    assert explanation == (
        "right: safe for 1 control period, then nothing is left that is predicted safe"
    )
    assert judged("step", 3)[0].reason is Reason.ACCEPTED
    assert judged("lookahead", 1)[0].reason is Reason.ACCEPTED


def test_plan_and_judge_proposal_do_not_draw() -> None:
    arbiter = two(rho=0.5)
    before = arbiter.state_dict()
    assert arbiter.plan(STATE).reason is Reason.PLANNER_TURN
    assert arbiter.judge_proposal(STATE, Proposal(1, False, None)).reason is Reason.ACCEPTED
    assert arbiter.state_dict() == before


def test_what_is_tried_for_the_sake_of_learning_is_no_plan() -> None:
    """In its turn in training the planner tries something; its plan and all others stay."""
    plain = two(rho=0.0)
    other = 1 - plain.plan(STATE).action
    exploring = Arbiter(
        plain.planner, plain.actions, plain.settings,
        exploration_bonus=lambda forecast: forecast._replace(choice=other),
    )  # fmt: skip
    tried = exploring.decide(STATE, propose(0))
    assert (tried.action, tried.reason, tried.executed_by) == (
        other,
        Reason.LITTLE_TRIED,
        Actor.PLANNER,
    )
    assert tried.forecast.choice == plain.plan(STATE).action
    assert not tried.vetoed
    assert exploring.explain(tried, STATE) == ""
    assert exploring.plan(STATE).action == plain.plan(STATE).action
    asked = Arbiter(
        plain.planner, plain.actions, ArbiterSettings(rho=1.0), exploration_bonus=lambda _: 1 / 0
    )
    assert asked.decide(STATE, propose(1)).executed_by is Actor.LEARNER


# Several ground actions, one environment action ------------------------------------------------

SHARED = """
(define (domain shared)
  (:predicates (unsafe))
  (:functions (x) (reward))
  (:action rich :parameters () :precondition (and) :effect (and (increase (reward) 5)))
  (:action risky :parameters () :precondition (and (> (x) 0)) :effect (and (unsafe)))
  (:action poor :parameters () :precondition (and) :effect (and)))
"""


def test_an_environment_action_is_as_unsafe_as_the_worst_it_may_stand_for() -> None:
    """The planner wants `rich`; what would be executed may turn out as `risky`."""
    model = load(SHARED.replace(":effect (and))", ":effect (and (increase (reward) 1)))"))
    actions = ActionMap(model, 2, {"rich": 0, "risky": 0, "poor": 1})
    arbiter = Arbiter(Lookahead(model), actions, ArbiterSettings())
    fine = arbiter.plan(np.array([0.0])[: len(model.fluents)])
    assert (fine.action, fine.proposed, fine.reason) == (0, 0, Reason.PLANNER_TURN)
    model_state = model.state({f.name: 1.0 for f in model.fluents})
    decision = arbiter.plan(model_state)
    assert (decision.action, decision.proposed) == (1, 1)
    assert not decision.unsafe
    assert not decision.proposal_unsafe
