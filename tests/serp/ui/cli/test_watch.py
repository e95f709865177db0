"""`serp watch`."""

from __future__ import annotations

from pathlib import Path

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
