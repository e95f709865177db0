"""Pictures come from what Gymnasium's render modes promise; what breaks that is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.error import DependencyNotInstalled

from serp.errors import EnvironmentFailure, TaskError
from serp.runs.run import Run, load_run
from serp.ui.pictures.film import Camera, render_mode_of
from tests.serp.sample_tasks import Corridor
from tests.serp.ui.pictures.scene import HEIGHT, WIDTH, Drawn, Ticking, bound, drawn


def run_of(recorded: Path, folder: Path, make_env: Any) -> Run:
    """The run, as if trained in another environment."""
    return load_run(recorded, drawn(folder, make_env))


def test_an_environment_with_several_pictures_a_step_gives_all(
    recorded: Path, tmp_path: Path
) -> None:
    assert render_mode_of(run_of(recorded, tmp_path, Drawn)) == "rgb_array"
    assert render_mode_of(run_of(recorded, tmp_path, Ticking)) == "rgb_array_list"
    task = bound(tmp_path, Ticking)
    camera = Camera(task)
    task.reset(seed=1)
    assert len(camera.take()) == 1
    task.step(1)
    task.step(1)
    pictures = camera.take()
    assert [picture.shape for picture in pictures] == [(HEIGHT, WIDTH, 3)] * 8


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
