"""Draw all shipped tasks as they look after a few steps: docs/images/tasks.png.

    python docs/drawings/tasks.py docs/images/tasks.png

Needs the extras `watch`, `soccer`, `minigrid` and `box2d`.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

import serp

TASKS = (
    "cartpole", "swing-up", "hill", "landing", "mountain-car", "acrobot", "lunar-lander", "cliff",
    "frozen-lake", "taxi", "door-key", "four-rooms", "soccer", "corner-kick",
)  # fmt: skip
COLUMNS, SIDE, GAP, LABEL = 7, 190, 10, 22
STEPS = {"lunar-lander": 60}
"""Steps before the picture; 12 for the others."""


def picture(name: str) -> Image.Image:
    """Return a picture of a task, within SIDE × SIDE pixels."""
    with serp.load_task(name).bind(render_mode="rgb_array") as task:
        task.reset(seed=4)
        for step in range(STEPS.get(name, 12)):
            if any(task.step(step % task.actions.size)[2:4]):
                task.reset(seed=4)
        image = Image.fromarray(task.env.render())  # type: ignore[arg-type]
    image.thumbnail((SIDE, SIDE))
    return image


def main(path: Path) -> None:
    """Draw the sheet."""
    rows = math.ceil(len(TASKS) / COLUMNS)
    size = COLUMNS * (SIDE + GAP) + GAP, rows * (SIDE + LABEL + GAP) + GAP
    sheet = Image.new("RGB", size, "white")
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(14)
    for index, name in enumerate(TASKS):
        row, column = divmod(index, COLUMNS)
        x, y = GAP + column * (SIDE + GAP), GAP + row * (SIDE + LABEL + GAP)
        image = picture(name)
        sheet.paste(image, (x + (SIDE - image.width) // 2, y + (SIDE - image.height) // 2))
        draw.text((x + SIDE / 2, y + SIDE + 4), name, fill="black", font=font, anchor="ma")
    sheet.quantize(128).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
