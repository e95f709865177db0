"""What is drawn is in the file, and a file is whole or not there; what cannot be drawn is named."""

import json
import os

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from serp.errors import EnvironmentFailure, RunError
from serp.runs.recording import EVALUATIONS, open_recording
from serp.runs.run import load_run
from serp.ui.pictures.camera import Camera
from serp.ui.pictures.film import film, write_film, write_mp4
from tests.serp.sample_tasks import CableCut
from tests.serp.ui.pictures.scene import Drawn, bound, drawn


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


def test_a_film_that_fails_leaves_the_former_one(recorded, tmp_path):
    def make_env(render_mode=None):
        return CableCut(Drawn(render_mode), 3)

    path = tmp_path / "x.mp4"
    path.write_bytes(b"former")
    with pytest.raises(EnvironmentFailure, match="cable cut"):
        write_film(load_run(recorded, drawn(tmp_path, make_env)), path, episodes=2)
    assert path.read_bytes() == b"former"
    assert list(tmp_path.glob("x.*")) == [path]


def test_an_environment_that_fails_to_draw_is_named(tmp_path):
    class Broken(Drawn):
        def render(self):
            raise DependencyNotInstalled("pygame is missing")

    with pytest.raises(EnvironmentFailure, match="pygame is missing .*'serp\\[watch\\]'"):
        Camera(bound(tmp_path, Broken)).take()
