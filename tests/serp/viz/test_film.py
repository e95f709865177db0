"""A film shows every step, every veto with its reason, and takes the time that the steps take."""

from __future__ import annotations

import functools
import itertools
from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from PIL import ImageColor

from serp._util import figures
from serp.control.step_record import StepRecord
from serp.errors import SettingsError
from serp.training.agent import Agent
from serp.training.evaluation import evaluate, play
from serp.viz.film import END, HOLD, EpisodeResult, FilmSettings, Frame, film, marks_of
from tests.serp.viz.scene import DT, Drawn, Ticking, Timed, bound, reckless_agent, several

RED = ImageColor.getrgb(figures.REFUSED)


@pytest.fixture
def agent(tmp_path: Path) -> Agent:
    return reckless_agent(tmp_path)


def filmed(agent: Agent, folder: Path, **settings: Any) -> list[Frame]:
    return list(film(agent, bound(folder), FilmSettings(**settings)))


def steps(agent: Agent, folder: Path, policy: Any = "serp", episodes: int = 3) -> list[StepRecord]:
    played = play(agent, bound(folder), policy, episodes=episodes)
    return [step for episode in played for step in episode.steps]


@pytest.mark.parametrize("settings", [{}, {"fps": 1}, {"speed": 30}, {"speed": 0.5, "fps": 2}])
def test_every_veto_is_on_a_frame(agent: Agent, tmp_path: Path, settings: Any) -> None:
    frames = filmed(agent, tmp_path, **settings)
    shown = {mark for frame in frames for mark in frame.caption.marks}
    vetoed = [step for step in steps(agent, tmp_path) if step.decision.vetoed]
    assert len(vetoed) > 3
    for step in vetoed:
        why = agent.arbiter.explain(step.decision, step.state)
        assert any(
            mark.what == f"Refused in step {step.number}: the learner's left"
            and why == f"left: {mark.why}"
            for mark in shown
        )


def test_a_mark_stays_until_it_can_be_read(agent: Agent, tmp_path: Path) -> None:
    for _, frames in itertools.groupby(
        filmed(agent, tmp_path, speed=4), lambda frame: frame.caption.facts[0]
    ):
        runs = [(marks, list(group)) for marks, group in
                itertools.groupby(frames, lambda frame: frame.caption.marks)]  # fmt: skip
        assert any(marks for marks, _ in runs)
        for (marks, group), after in itertools.pairwise([*runs, ((), [])]):
            cut = bool(after[0])
            if marks and not cut:
                assert sum(frame.seconds for frame in group) >= HOLD - 1e-9


@pytest.mark.parametrize("policy", ["serp", "planner", "learner"])
def test_every_step_has_a_frame_that_says_who_acts(
    agent: Agent, tmp_path: Path, policy: Any
) -> None:
    frames = filmed(agent, tmp_path, policy=policy)
    shown = [frame.step for frame in frames if frame.step is not None]
    assert len(frames) == len(shown) + 3  # each episode's beginning
    for frame in frames:
        if frame.step is not None:
            decision = frame.step.decision
            assert frame.caption.actor is decision.executed_by
            assert frame.caption.action == agent.task.actions.name(decision.action)
            assert frame.caption.strip[-1] == (decision.executed_by, decision.vetoed)
    played = steps(agent, tmp_path, policy)
    assert [s.number for s in shown] == [s.number for s in played]
    assert [s.decision.action for s in shown] == [s.decision.action for s in played]


@pytest.mark.parametrize("policy", ["serp", "learner"])
def test_the_film_is_of_what_an_evaluation_measures(
    agent: Agent, tmp_path: Path, policy: Any
) -> None:
    results: list[EpisodeResult] = []
    settings = FilmSettings(policy=policy, episodes=4, seed=3)
    for _ in film(agent, bound(tmp_path), settings, results.append):
        pass
    measured = evaluate(agent, bound(tmp_path), policy, episodes=4, seed=3)
    assert tuple(result.total for result in results) == measured.returns
    assert tuple(result.steps for result in results) == measured.lengths
    assert sum(result.vetoes for result in results) == measured.vetoes
    assert sum(result.unsafe for result in results) == measured.unsafe_executed


def test_an_unsafe_action_executed_is_marked(agent: Agent, tmp_path: Path) -> None:
    unsafe = [s for s in steps(agent, tmp_path, "learner") if s.decision.unsafe]
    assert unsafe
    for step in unsafe:
        (mark,) = marks_of(agent, step)
        assert mark.what == f"Unsafe, executed in step {step.number}: left"
        assert "event pit" in mark.why
    assert not any(marks_of(agent, s) for s in steps(agent, tmp_path, "planner"))


def test_marked_frames_are_red_below_and_the_others_are_not(agent: Agent, tmp_path: Path) -> None:
    frames = filmed(agent, tmp_path)
    assert {bool(frame.caption.marks) for frame in frames} == {True, False}
    for frame in frames:
        corner = frame.image.getpixel((0, frame.image.height - 1))
        assert (corner == RED) == bool(frame.caption.marks)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
@pytest.mark.parametrize(
    ("take", "each"),
    [
        (bound, 1),
        (functools.partial(several, make_env=Ticking), 4),
        (functools.partial(several, make_env=Timed), 4),
    ],
    ids=["one picture a step", "several", "several with render_fps"],
)
def test_time_is_real_time(
    agent: Agent, tmp_path: Path, take: Any, each: int, speed: float
) -> None:
    settings = FilmSettings(speed=speed, fps=1e6, policy="planner")
    lasting: dict[tuple[str, int], list[float]] = defaultdict(list)
    for frame in film(agent, take(tmp_path), settings):
        if frame.step is not None:
            end = END if frame.step.last and len(
                lasting[frame.caption.facts[0], frame.step.number]
            ) == each - 1 else 0.0  # fmt: skip
            lasting[frame.caption.facts[0], frame.step.number].append(frame.seconds - end)
    step = 4 / 50 if getattr(take, "keywords", {}).get("make_env") is Timed else DT
    for seconds in lasting.values():
        assert len(seconds) == each
        assert sum(seconds) == pytest.approx(step / speed)


class Judged(Drawn):
    """Says how an episode stands."""

    def info(self) -> dict[str, Any]:
        return {**super().info(), "outcome": "home" if self.x >= 4 else f"at {self.x}"}


def test_the_last_picture_says_how_the_episode_ended(agent: Agent, tmp_path: Path) -> None:
    results: list[EpisodeResult] = []
    settings = FilmSettings(policy="planner", episodes=4)
    frames = list(film(agent, bound(tmp_path, Judged), settings, results.append))
    said = [frame.caption.outcome for frame in frames if frame.step and frame.step.last]
    assert said == [result.outcome for result in results]
    assert "home" in said
    assert not any(
        frame.caption.outcome for frame in frames if not (frame.step and frame.step.last)
    )
    assert not any(frame.caption.outcome for frame in filmed(agent, tmp_path))


def test_no_more_frames_a_second_than_asked_for(agent: Agent, tmp_path: Path) -> None:
    every = filmed(agent, tmp_path, policy="planner", episodes=5)
    fewer = filmed(agent, tmp_path, policy="planner", episodes=5, fps=5)
    assert all(frame.seconds >= 1 / 5 for frame in fewer)
    assert len(fewer) <= len(every) / 2 + 2 * 5
    for frames in (every, fewer):
        assert sum(frame.step is None for frame in frames) == 5
        assert sum(frame.step is not None and frame.step.last for frame in frames) == 5


@pytest.mark.parametrize(
    ("limits", "size"),
    [({}, (420, 82)), ({"width": 210}, (210, 40)), ({"width": 900}, (420, 82)),
     ({"height": 41}, (212, 40))],
)  # fmt: skip
def test_pictures_keep_within_their_limits(
    agent: Agent, tmp_path: Path, limits: Any, size: tuple[int, int]
) -> None:
    frames = filmed(agent, tmp_path, episodes=2, **limits)
    (whole,) = {frame.image.size for frame in frames}
    assert whole[0] == size[0]
    assert whole[1] > size[1]
    assert whole[1] % 2 == 0


@pytest.mark.parametrize("wrong", [{"speed": 0}, {"speed": -1}, {"fps": 0.5}, {"speed": "x"},
                                   {"fps": float("nan")}])  # fmt: skip
def test_senseless_settings_are_refused(wrong: Any) -> None:
    with pytest.raises(SettingsError, match="must be"):
        FilmSettings(**wrong)


def test_what_cannot_be_played_is_refused_at_once(agent: Agent, tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match="at least one"):
        film(agent, bound(tmp_path), FilmSettings(episodes=0))
    with pytest.raises(SettingsError, match=r"film\.policy must be 'serp', 'planner'"):
        FilmSettings(policy="best")
