"""What is drawn is in the file, and a file is whole or not there; what cannot be drawn is named."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from serp.errors import EnvironmentFailure, RunError, TaskError
from serp.runs.recording import EVALUATIONS, open_recording
from serp.runs.run import Run, load_run
from serp.ui.pictures.camera import Camera
from serp.ui.pictures.film import Frame, film, render_mode_of, write_film, write_mp4
from tests.serp.sample_tasks import CableCut, Corridor
from tests.serp.ui.pictures.scene import Drawn, Ticking, bound, drawn


def frames_of(run: Run, folder: Path) -> list[Frame]:
    return list(film(run.agent, bound(folder), episodes=2))


def files_of(run: Run) -> dict[Path, bytes]:
    """All files of a run but those of evaluations."""
    files = (path for path in run.path.rglob("*") if path.is_file())
    return {path: path.read_bytes() for path in files if EVALUATIONS not in path.parts}


def test_equal_films_give_equal_files_and_change_nothing_else(run: Run, tmp_path: Path) -> None:
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


def test_an_mp4_lasts_as_long_as_the_film(run: Run, tmp_path: Path) -> None:
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


def test_a_film_that_fails_leaves_the_former_one(recorded: Path, tmp_path: Path) -> None:
    def make_env(render_mode: str | None = None) -> Any:
        return CableCut(Drawn(render_mode), 3)

    path = tmp_path / "x.mp4"
    path.write_bytes(b"former")
    with pytest.raises(EnvironmentFailure, match="cable cut"):
        write_film(load_run(recorded, drawn(tmp_path, make_env)), path, episodes=2)
    assert path.read_bytes() == b"former"
    assert list(tmp_path.glob("x.*")) == [path]


def run_of(recorded: Path, folder: Path, make_env: Any) -> Run:
    """The run, as if trained in another environment."""
    return load_run(recorded, drawn(folder, make_env))


def test_the_render_mode_with_the_most_pictures_is_chosen(recorded: Path, tmp_path: Path) -> None:
    assert render_mode_of(run_of(recorded, tmp_path, Drawn)) == "rgb_array"
    assert render_mode_of(run_of(recorded, tmp_path, Ticking)) == "rgb_array_list"


def test_environments_that_cannot_draw_are_told_how(recorded: Path, tmp_path: Path) -> None:
    class Blind(Corridor):
        def __init__(self, render_mode: str | None = None) -> None:
            super().__init__()

    with pytest.raises(TaskError, match="draws no pictures; it needs the render mode `rgb_array`"):
        render_mode_of(run_of(recorded, tmp_path, Blind))


@pytest.mark.parametrize("picture", [None, np.zeros((4, 4, 3)), np.zeros((4, 4, 4), np.uint8)])
def test_what_is_no_picture_is_refused(tmp_path: Path, picture: Any) -> None:
    class Odd(Drawn):
        def render(self) -> Any:
            return picture

    with pytest.raises(EnvironmentFailure, match="a picture is uint8 of shape"):
        Camera(bound(tmp_path, Odd)).take()


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (ZeroDivisionError("no light"), "task corridor: render failed: .*no light"),
        (DependencyNotInstalled("pygame is missing"), "pygame is missing .*'serp\\[watch\\]'"),
    ],
)
def test_an_environment_that_fails_to_draw_is_named(
    tmp_path: Path, error: Exception, says: str
) -> None:
    class Broken(Drawn):
        def render(self) -> Any:
            raise error

    with pytest.raises(EnvironmentFailure, match=says):
        Camera(bound(tmp_path, Broken)).take()
