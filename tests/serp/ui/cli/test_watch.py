"""`serp watch`."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from PIL import Image

from serp.runs.run import load_run
from tests.serp.ui.cli.conftest import Run


def test_cartpole_on_a_gif(run: Run, trained: Path) -> None:
    done = run("watch", str(trained), "--episodes=2", "--seed=4", "--out=x.gif")
    measured = load_run(trained).evaluate(episodes=2, seed=4)
    with Image.open("x.gif") as gif:
        assert gif.width == 600
        assert gif.n_frames == sum(measured.lengths) + 2  # type: ignore[attr-defined]
    assert done.stdout.startswith("x.gif: 0.")
    for number, value in enumerate(measured.returns, 1):
        assert f"episode {number}: return {value:g} in " in done.stderr


def test_usage_errors(run: Run, trained: Path) -> None:
    assert "ends in .gif or .mp4" in run("watch", str(trained), "--out=x.avi", expect=2).stderr
    for wrong in ("--policy=best", "--episodes=0", "--speed=0"):
        run("watch", str(trained), "--out=x.gif", wrong, expect=2)
    run("watch", expect=2)
    assert not list(Path().glob("x.*"))


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="these need no DISPLAY")
def test_without_a_screen_the_message_says_what_to_do(
    run: Run, trained: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.setenv(name, "")  # so that it is restored
        monkeypatch.delenv(name)
    (line,) = run("watch", str(trained), expect=1).stderr.splitlines()
    assert line.startswith("Error: no window can be opened here")
    assert "--out FILE.gif" in line
