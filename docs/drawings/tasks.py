"""Draw each shipped task as it looks after a few steps: docs/images/tasks/NAME.png.

    python docs/drawings/tasks.py docs/images/tasks

Needs the extras `watch`, `soccer`, `minigrid` and `box2d`.
"""

from __future__ import annotations

import sys
from pathlib import Path

from PIL import Image, ImageChops

import serp

TASKS = (
    "cartpole", "swing-up", "hill", "landing", "mountain-car", "acrobot", "lunar-lander", "cliff",
    "frozen-lake", "taxi", "door-key", "four-rooms", "soccer", "corner-kick",
)  # fmt: skip
SIZE = (420, 300)
MARGIN = 16  # around what is not background
STEPS = {"lunar-lander": 60, "frozen-lake": 3}
"""Steps before the picture; 12 for the others."""
PARTS = {"soccer": (0.1, 0.15, 0.9, 0.75), "corner-kick": (0.2, 0.4, 1.0, 1.0)}
"""Left, top, right and bottom of what is shown; everything of the others."""


def picture(name: str) -> Image.Image:
    """Return the picture of a task's environment."""
    with serp.load_task(name).bind(render_mode="rgb_array") as task:
        task.reset(seed=4)
        for step in range(STEPS.get(name, 12)):
            if any(task.step(step % task.actions.size)[2:4]):
                task.reset(seed=4)
        image = Image.fromarray(task.env.render())  # type: ignore[arg-type]
    left, top, right, bottom = PARTS.get(name, (0, 0, 1, 1))
    wide, high = image.size
    return image.crop(
        (round(left * wide), round(top * high), round(right * wide), round(bottom * high))
    )


def framed(image: Image.Image) -> Image.Image:
    """Return a picture of SIZE: what is not background, as large as it may be, in its middle."""
    background = image.getpixel((0, 0))
    plain = Image.new("RGB", image.size, background)
    left, top, right, bottom = ImageChops.difference(image, plain).getbbox() or (0, 0, *image.size)
    image = image.crop(
        (max(left - MARGIN, 0), max(top - MARGIN, 0),
         min(right + MARGIN, image.width), min(bottom + MARGIN, image.height))
    )  # fmt: skip
    scale = min(SIZE[0] / image.width, SIZE[1] / image.height)
    image = image.resize((round(scale * image.width), round(scale * image.height)), Image.LANCZOS)
    frame = Image.new("RGB", SIZE, background)
    frame.paste(image, ((SIZE[0] - image.width) // 2, (SIZE[1] - image.height) // 2))
    return frame


def main(folder: Path) -> None:
    """Draw all tasks."""
    folder.mkdir(exist_ok=True)
    for name in TASKS:
        framed(picture(name)).quantize(256).save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
