"""What is on the film is in the file, and a file is whole or not there."""

from __future__ import annotations

import io
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageColor

from serp._util import figures
from serp.errors import EnvironmentFailure, MissingExtra, RunError, SerpError
from serp.training.run import Run, load_run
from serp.viz.film import FilmSettings, Frame, film
from serp.viz.gif import write_gif
from serp.viz.video import find_ffmpeg, write_mp4
from serp.viz.watch import write_film
from tests.serp.sample_tasks import CableCut
from tests.serp.viz.scene import Drawn, bound, drawn

RED = np.array(ImageColor.getrgb(figures.REFUSED))
SETTINGS = FilmSettings(episodes=2)


def frames_of(run: Run, folder: Path) -> list[Frame]:
    return list(film(run.agent, bound(folder), SETTINGS))


def decoded(path: Path) -> tuple[list[np.ndarray[Any, Any]], list[float]]:
    """Pictures of a GIF, and the seconds that each stands."""
    pictures, seconds = [], []
    with Image.open(path) as gif:
        for number in range(getattr(gif, "n_frames", 1)):
            gif.seek(number)
            pictures.append(np.asarray(gif.convert("RGB")).astype(int))
            seconds.append(gif.info["duration"] / 1000)
    return pictures, seconds


def test_a_gif_has_a_frame_for_every_step(run: Run, tmp_path: Path) -> None:
    written = write_film(run, tmp_path / "x.gif", SETTINGS)
    steps = sum(run.evaluate(episodes=2).lengths)
    pictures, seconds = decoded(written.path)
    assert written.frames == len(pictures) == steps + 2
    assert written.seconds == pytest.approx(sum(seconds), abs=0.01)
    assert written.size == written.path.stat().st_size


def test_a_gif_shows_what_was_filmed(run: Run, tmp_path: Path) -> None:
    frames = frames_of(run, tmp_path)
    write_gif(tmp_path / "x.gif", frames)
    pictures, seconds = decoded(tmp_path / "x.gif")
    assert seconds == pytest.approx([frame.seconds for frame in frames], abs=0.01)
    assert any(frame.caption.marks for frame in frames)
    for frame, picture in zip(frames, pictures, strict=True):
        error = np.abs(picture - np.asarray(frame.image).astype(int))
        assert error.max() <= 48  # of 255: letters have more shades than the palette
        assert error.mean() < 0.5
        red = np.abs(picture[-1, 0] - RED).max() <= 2
        assert red == bool(frame.caption.marks)


def test_a_gif_stores_what_changed(run: Run, tmp_path: Path) -> None:
    frames = frames_of(run, tmp_path)
    write_gif(tmp_path / "x.gif", frames)
    buffer = io.BytesIO()
    frames[-1].image.quantize().save(buffer, "GIF")
    assert (tmp_path / "x.gif").stat().st_size < 0.5 * len(frames) * len(buffer.getvalue())


def test_equal_films_give_equal_files(run: Run, tmp_path: Path) -> None:
    for name in ("one.gif", "other.gif"):
        write_film(run, tmp_path / name, SETTINGS)
    assert (tmp_path / "one.gif").read_bytes() == (tmp_path / "other.gif").read_bytes()


def test_an_mp4_lasts_as_long_as_the_film(run: Run, tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    written = write_film(run, tmp_path / "x.mp4", SETTINGS)
    frames, seconds = ffmpeg.count_frames_and_secs(str(written.path))
    assert frames == written.frames
    assert seconds == pytest.approx(written.seconds, abs=0.2)
    (size,) = {frame.image.size for frame in frames_of(run, tmp_path)}
    reader = ffmpeg.read_frames(str(written.path))
    assert next(reader)["size"] == size
    picture = np.frombuffer(next(reader), np.uint8).reshape(size[1], size[0], 3).astype(int)
    reader.close()
    first = np.asarray(frames_of(run, tmp_path)[0].image).astype(int)
    assert np.abs(picture - first).mean() < 6


def test_an_mp4_that_ffmpeg_cannot_write_is_an_error(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    with pytest.raises(RunError, match="ffmpeg could not write .*nosuch"):
        write_mp4(tmp_path / "nosuch" / "x.mp4", frames_of(run, tmp_path))


def test_without_ffmpeg_the_extra_is_named(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtra, match="pip install 'serp\\[watch\\]'"):
        find_ffmpeg()
    with pytest.raises(MissingExtra):
        write_film(run, tmp_path / "x.mp4", SETTINGS)
    assert not list(tmp_path.glob("x.mp4*"))


def test_a_film_that_fails_leaves_the_former_one(recorded: Path, tmp_path: Path) -> None:
    def make_env(render_mode: str | None = None) -> Any:
        return CableCut(Drawn(render_mode), 3)

    path = tmp_path / "x.gif"
    path.write_bytes(b"former")
    with pytest.raises(EnvironmentFailure, match="cable cut"):
        write_film(load_run(recorded, drawn(tmp_path, make_env)), path, SETTINGS)
    assert path.read_bytes() == b"former"
    assert list(tmp_path.glob("x.gif*")) == [path]


def test_a_folder_that_is_not_there_is_noticed_before_all_work(run: Run, tmp_path: Path) -> None:
    played: list[object] = []
    with pytest.raises(RunError, match="cannot write .*Make sure that the folder still exists"):
        write_film(run, tmp_path / "nosuch" / "x.gif", SETTINGS, played.append)
    assert played == []


def test_other_kinds_of_files_are_refused(run: Run, tmp_path: Path) -> None:
    with pytest.raises(SerpError, match="a film is a GIF or an MP4"):
        write_film(run, tmp_path / "x.avi", SETTINGS)


def test_filming_changes_neither_the_run_nor_the_process(run: Run, tmp_path: Path) -> None:
    before = dict(os.environ)
    kept = {path: path.read_bytes() for path in run.path.iterdir()}
    agent = json.dumps(run.agent.state_dict()[1], sort_keys=True)
    write_film(run, tmp_path / "x.gif", SETTINGS)
    assert dict(os.environ) == before
    assert {path: path.read_bytes() for path in run.path.iterdir()} == kept
    assert json.dumps(run.agent.state_dict()[1], sort_keys=True) == agent
