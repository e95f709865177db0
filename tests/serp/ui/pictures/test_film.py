"""A film shows every step, every veto with its reason, and takes the time that the steps take."""

import itertools
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from PIL import ImageColor

from serp._util import figures
from serp.agent.agent import Agent
from serp.agent.step_record import StepRecord
from serp.runs.evaluation import evaluate, play
from serp.ui.pictures.film import END, HOLD, Mark, film, marks_of
from tests.serp.ui.pictures.scene import DT, Drawn, Ticking, Timed, bound, reckless_agent

RED = ImageColor.getrgb(figures.REFUSED)


@pytest.fixture
def agent(tmp_path: Path) -> Agent:
    return reckless_agent(tmp_path)


def steps(agent: Agent, folder: Path, policy: Any = "serp") -> list[StepRecord]:
    played = play(agent, bound(folder), policy, episodes=3)
    return [step for episode in played for step in episode.steps]


def test_every_veto_is_shown_until_it_can_be_read(agent: Agent, tmp_path: Path) -> None:
    frames = list(film(agent, bound(tmp_path)))
    shown = {mark for frame in frames for mark in frame.caption.marks}
    vetoed = [step for step in steps(agent, tmp_path) if step.decision.vetoed]
    assert len(vetoed) > 3
    for step in vetoed:
        why = agent.arbiter.explain(step.decision, step.state).removeprefix("left: ")
        assert Mark(f"Refused in step {step.number}: left, proposed by learner", why) in shown
    for frame in frames:
        corner = frame.image.getpixel((0, frame.image.height - 1))
        assert (corner == RED) == bool(frame.caption.marks)
    for _, episode in itertools.groupby(frames, lambda frame: frame.caption.facts[0]):
        runs = [(marks, list(group)) for marks, group in
                itertools.groupby(episode, lambda frame: frame.caption.marks)]  # fmt: skip
        for (marks, group), (after, _) in itertools.pairwise([*runs, ((), [])]):
            if marks and not after:
                assert sum(frame.seconds for frame in group) >= HOLD - 1e-9


@pytest.mark.parametrize("policy", ["serp", "learner"])
def test_every_step_that_an_evaluation_measures_has_a_frame_that_says_who_acts(
    agent: Agent, tmp_path: Path, policy: Any
) -> None:
    results: dict[int, StepRecord] = {}
    shown_by = film(agent, bound(tmp_path), policy, 4, 3, on_episode=results.__setitem__)
    frames = list(shown_by)
    shown = [frame.caption for frame in frames if frame.caption.actor is not None]
    assert len(frames) == len(shown) + 4  # each episode's beginning
    played = [step for episode in play(agent, bound(tmp_path), policy, episodes=4, seed=3)
              for step in episode.steps]  # fmt: skip
    assert [(caption.actor, caption.action) for caption in shown] == [
        (step.decision.executed_by, agent.task.actions.name(step.decision.action))
        for step in played
    ]
    measured = evaluate(agent, bound(tmp_path), policy, episodes=4, seed=3)
    assert len(shown) == sum(measured.lengths)
    assert tuple(results) == (1, 2, 3, 4)
    totals = [last.episode for last in results.values()]
    assert tuple(total.return_ for total in totals) == measured.returns
    assert sum(total.decisions.vetoes for total in totals) == measured.vetoes
    assert sum(total.decisions.unsafe_executed for total in totals) == measured.unsafe_executed


def test_an_unsafe_action_executed_is_marked(agent: Agent, tmp_path: Path) -> None:
    unsafe = [s for s in steps(agent, tmp_path, "learner") if s.decision.unsafe]
    assert unsafe
    for step in unsafe:
        (mark,) = marks_of(agent, step)
        assert mark.what == f"Unsafe, executed in step {step.number}: left"
        assert "event pit" in mark.why
    assert not any(marks_of(agent, s) for s in steps(agent, tmp_path, "planner"))


@pytest.mark.parametrize(
    ("make_env", "each", "step"), [(Drawn, 1, DT), (Ticking, 4, DT), (Timed, 4, 4 / 50)]
)
def test_time_is_real_time(
    agent: Agent, tmp_path: Path, make_env: Any, each: int, step: float
) -> None:
    lasting: dict[tuple[str, ...], list[float]] = defaultdict(list)
    for frame in film(agent, bound(tmp_path, make_env), "planner"):
        if frame.caption.actor is not None:
            lasting[frame.caption.facts[:2]].append(frame.seconds)
    lasts = {episode: key for key in lasting for episode in key[:1]}.values()
    for key, times in lasting.items():
        assert len(times) == each
        assert sum(times) == pytest.approx(step + (END if key in lasts else 0.0))
