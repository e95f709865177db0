"""A film shows every step and every veto, takes the time that the steps take, and is whole."""

import itertools
import json
import os

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled
from PIL import ImageColor

from serp._util import figures
from serp.agent.agent import Agent
from serp.errors import EnvironmentFailure, RunError
from serp.runs.evaluation import evaluate, play
from serp.runs.recording import EVALUATIONS, open_recording
from serp.settings import resolve
from serp.ui.pictures.camera import Camera
from serp.ui.pictures.film import HOLD, Mark, film, write_film, write_mp4
from tests.serp.sample_tasks import reckless
from tests.serp.ui.pictures.scene import Drawn, bound, drawn

RED = ImageColor.getrgb(figures.REFUSED)


@pytest.fixture
def agent(tmp_path):
    task = drawn(tmp_path)
    changes = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}}
    return reckless(Agent(task.bind(), resolve("default", task.settings, changes), 0))


def steps(agent, folder, policy="serp"):
    played = play(agent, bound(folder), policy, episodes=3)
    return [step for episode in played for step in episode]


def test_every_veto_is_shown_until_it_can_be_read(agent, tmp_path):
    frames = list(film(agent, bound(tmp_path)))
    shown = {mark for frame in frames for mark in frame.caption.marks}
    vetoed = [step for step in steps(agent, tmp_path) if step.decision.vetoed]
    assert len(vetoed) > 3
    for step in vetoed:
        why = agent.arbiter.explain(step.decision, step.state).removeprefix("left: ")
        assert Mark(f"Refused in step {step.number - 1}: left, proposed by learner", why) in shown
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
    agent, tmp_path, policy
):
    frames = [*film(agent, bound(tmp_path), policy, 4, 3)]
    shown = [frame.caption for frame in frames if frame.caption.actor is not None]
    assert len(frames) == len(shown) + 4  # each episode's beginning
    played = [step for episode in play(agent, bound(tmp_path), policy, episodes=4, seed=3)
              for step in episode]  # fmt: skip
    assert [(caption.actor, caption.action) for caption in shown] == [
        (step.decision.executed_by, agent.task.actions.name(step.decision.action))
        for step in played
    ]
    measured = evaluate(agent, bound(tmp_path), policy, episodes=4, seed=3)
    assert len(shown) == sum(measured.lengths)


def frames_of(run, folder):
    return list(film(run.agent, bound(folder), episodes=2))


def files_of(run):
    """All files of a run but those of evaluations."""
    files = (path for path in run.path.rglob("*") if path.is_file())
    return {path: path.read_bytes() for path in files if EVALUATIONS not in path.parts}


def test_equal_films_give_equal_files_and_change_nothing_else(run, tmp_path):
    before = dict(os.environ)
    kept = files_of(run)
    agent = json.dumps(run.agent.state_dict()[1], sort_keys=True)
    for name in ("one.mp4", "other.mp4"):
        write_film(run, tmp_path / name, episodes=2)
    assert (tmp_path / "one.mp4").read_bytes() == (tmp_path / "other.mp4").read_bytes()
    assert dict(os.environ) == before
    assert files_of(run) == kept
    assert list(open_recording(run.path, "serp-seed0").episodes) == [1, 2]
    assert json.dumps(run.agent.state_dict()[1], sort_keys=True) == agent


def test_an_mp4_lasts_as_long_as_the_film(run, tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "x.mp4"
    write_film(run, path, episodes=2)
    filmed = frames_of(run, tmp_path)
    _, seconds = ffmpeg.count_frames_and_secs(str(path))
    assert seconds == pytest.approx(sum(frame.seconds for frame in filmed), abs=0.2)
    (size,) = {frame.image.size for frame in filmed}
    reader = ffmpeg.read_frames(str(path))
    assert next(reader)["size"] == size
    picture = np.frombuffer(next(reader), np.uint8).reshape(size[1], size[0], 3).astype(int)
    reader.close()
    assert np.abs(picture - np.asarray(filmed[0].image).astype(int)).mean() < 6
    with pytest.raises(RunError, match="ffmpeg could not write .*nosuch"):
        write_mp4(tmp_path / "nosuch" / "x.mp4", iter(filmed))


def test_an_environment_that_fails_to_draw_is_named(tmp_path):
    class Broken(Drawn):
        def render(self):
            raise DependencyNotInstalled("pygame is missing")

    with pytest.raises(EnvironmentFailure, match="pygame is missing .*'serp\\[watch\\]'"):
        Camera(bound(tmp_path, Broken)).take()
