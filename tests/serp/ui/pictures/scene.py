"""A corridor that draws itself, and an agent whose learner always wants to walk into the pit."""

from typing import Any, ClassVar

import numpy as np

from tests.serp.sample_tasks import Corridor, corridor

DT = 0.1
WIDTH, HEIGHT = 420, 81


class Drawn(Corridor):
    """A picture a step: the robot is a bar, where it stands."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self, render_mode=None):
        super().__init__()
        self.render_mode = render_mode

    def render(self):
        pixels = np.full((HEIGHT, WIDTH, 3), 230, np.uint8)
        middle = WIDTH // 2 + 50 * self.x
        pixels[20:60, max(0, middle - 10) : middle + 10] = (20, 90, 160)
        return pixels


def drawn(folder, make_env=Drawn):
    return corridor(folder, make_env, dt=DT)


def bound(folder, make_env=Drawn):
    mode = make_env.metadata["render_modes"][-1]
    return drawn(folder, make_env).bind(render_mode=mode)
