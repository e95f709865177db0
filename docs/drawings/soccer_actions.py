"""Draw the defender's three moves, as in the paper's Figure 3, from the simulation itself.

    python docs/drawings/soccer_actions.py docs/images/soccer-actions.png

Every panel starts from the same contest and holds one action. Where the robots and the ball have
been stays on the picture, fainter the longer ago.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

SEED = 22
MOVES = (("cover-goal", 0), ("side-advance left", 1), ("frontal-contrast", 3))
WIDTH = 360
BAND = 40
AROUND = 190
"""Pixels of the environment's picture that are shown to each side of the middle."""


class Frame(NamedTuple):
    """A picture of the environment, and where robots and ball are on it: middle and radius."""

    picture: NDArray[np.uint8]
    circles: tuple[tuple[tuple[int, int], int], ...]


def frames(action: int, decisions: int) -> list[Frame]:
    """Return the pictures of an action held for some decisions, or until the contest ends."""
    env = gymnasium.make("serp_envs:serp/SoccerDefender-v0", render_mode="rgb_array")
    _, info = env.reset(seed=SEED)
    seen = [frame(env, info)]
    for _ in range(decisions):
        _, _, terminated, truncated, info = env.step(action)
        seen.append(frame(env, info))
        if terminated or truncated:
            break
    env.close()
    return seen


def frame(env: gymnasium.Env[Any, Any], info: dict[str, Any]) -> Frame:
    """Return what is to be seen now."""
    radii = {"ball": 7, "attacker": 20, "defender": 20}
    return Frame(
        np.asarray(env.render()),
        tuple((pixels(info[f"{k}_x"], info[f"{k}_y"]), r) for k, r in radii.items()),
    )


def pixels(x: float, y: float) -> tuple[int, int]:
    """Return where a place of the pitch is in the environment's picture (120 pixels a metre)."""
    return round(444 - 119.5 * y), round(683 - 119.8 * (x + 4.5))


def faded(seen: list[Frame]) -> NDArray[np.uint8]:
    """Lay pictures over one another: the last as it is, what was before fainter and fainter."""
    shown = seen[-1].picture.astype(np.float64)
    last = around(seen[-1])
    for age in range(len(seen) - 1, 0, -1):
        there = around(seen[-1 - age]) & ~last
        strength = max(0.15, 0.5 - 0.05 * age)
        before = seen[-1 - age].picture
        shown = np.where(there, (1 - strength) * shown + strength * before, shown)
    return shown.astype(np.uint8)


def around(frame: Frame) -> NDArray[np.bool_]:
    """Return `[height, width, 1]` which pixels robots and ball cover."""
    rows, columns = np.ogrid[: frame.picture.shape[0], : frame.picture.shape[1]]
    covered = np.zeros(frame.picture.shape[:2], dtype=np.bool_)
    for (x, y), radius in frame.circles:
        covered |= (columns - x) ** 2 + (rows - y) ** 2 <= radius**2
    return covered[..., None]


def panel(name: str, seen: list[Frame]) -> Image.Image:
    """Return one panel, with the name of the action above it."""
    picture = Image.fromarray(faded(seen))
    (x, y), _ = seen[0].circles[0]
    # The goal is below. Outside of the picture nothing is shown.
    middle = x, min(y + AROUND // 3, picture.height - AROUND)
    box = (middle[0] - AROUND, middle[1] - AROUND, middle[0] + AROUND, middle[1] + AROUND)
    shown = picture.crop(box).resize((WIDTH, WIDTH), Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (WIDTH, WIDTH + BAND), (22, 26, 34))
    whole.paste(shown, (0, BAND))
    fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    font = ImageFont.truetype(str(fonts / "DejaVuSans-Bold.ttf"), 20)
    ImageDraw.Draw(whole).text((WIDTH / 2, BAND / 2), name, (240, 240, 240), font, anchor="mm")
    return whole


def beside(panels: list[Image.Image]) -> Image.Image:
    """Return the panels side by side."""
    gap = 8
    whole = Image.new("RGB", (len(panels) * (WIDTH + gap) - gap, WIDTH + BAND), "white")
    for k, picture in enumerate(panels):
        whole.paste(picture, (k * (WIDTH + gap), 0))
    return whole


def main() -> None:
    """Draw the panels side by side."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--decisions", type=int, default=9)
    options = parser.parse_args()
    moves = [panel(name, frames(action, options.decisions)) for name, action in MOVES]
    beside(moves).save(options.out, optimize=True)


if __name__ == "__main__":
    main()
