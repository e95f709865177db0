"""A corridor that draws itself, and an agent whose learner always wants to walk into the pit."""

from typing import Any, ClassVar

import numpy as np

from serp.agent.agent import Agent
from serp.settings import resolve
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
        return self.picture()

    def picture(self):
        pixels = np.full((HEIGHT, WIDTH, 3), 230, np.uint8)
        middle = WIDTH // 2 + 50 * self.x
        pixels[20:60, max(0, middle - 10) : middle + 10] = (20, 90, 160)
        return pixels


def drawn(folder, make_env=Drawn):
    return corridor(folder, make_env, dt=DT)


def reckless(agent):
    """Let all actions look alike to the learner: it takes the first, `left`, into the pit."""
    arrays, meta = agent.learner.state_dict()
    arrays["parameters"] = np.zeros_like(arrays["parameters"])
    agent.learner.load_state_dict(arrays, meta)
    return agent


def bound(folder, make_env=Drawn):
    mode = make_env.metadata["render_modes"][-1]
    return drawn(folder, make_env).bind(render_mode=mode)


def reckless_agent(folder):
    task = drawn(folder)
    changes = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}}
    return reckless(Agent(task.bind(), resolve("default", task.settings, changes), 0))
