"""A corridor that draws itself, and an agent whose learner always wants to walk into the pit."""

from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from serp.agent.agent import Agent
from serp.settings import resolve
from serp.tasks.task import BoundTask, Task
from tests.serp.sample_tasks import Corridor, corridor

DT = 0.1
WIDTH, HEIGHT = 420, 81


class Drawn(Corridor):
    """A picture a step: the robot is a bar, where it stands."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self, render_mode: str | None = None) -> None:
        super().__init__()
        self.render_mode = render_mode

    def render(self) -> Any:
        return self.picture()

    def picture(self) -> NDArray[np.uint8]:
        pixels = np.full((HEIGHT, WIDTH, 3), 230, np.uint8)
        middle = WIDTH // 2 + 50 * self.x
        pixels[20:60, max(0, middle - 10) : middle + 10] = (20, 90, 160)
        return pixels


class Ticking(Drawn):
    """Four pictures a step, one at the reset."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array", "rgb_array_list"]}

    def reset(self, **options: Any) -> Any:
        self.due = 1
        return super().reset(**options)

    def step(self, action: int) -> Any:
        self.due += 4
        return super().step(action)

    def render(self) -> Any:
        due, self.due = self.due, 0
        return [self.picture()] * due


class Timed(Ticking):
    """The same, and says how fast they follow each other."""

    metadata: ClassVar[dict[str, Any]] = {**Ticking.metadata, "render_fps": 50}


def drawn(folder: Path, make_env: Any = Drawn) -> Task:
    return corridor(folder, make_env, dt=DT)


def reckless(agent: Agent) -> Agent:
    """Let all actions look alike to the learner: it takes the first, `left`, into the pit."""
    arrays, meta = agent.learner.state_dict()
    arrays["parameters"] = np.zeros_like(arrays["parameters"])
    agent.learner.load_state_dict(arrays, meta)
    return agent


def bound(folder: Path, make_env: Any = Drawn) -> BoundTask:
    mode = make_env.metadata["render_modes"][-1]
    return drawn(folder, make_env).bind(render_mode=mode)


def reckless_agent(folder: Path) -> Agent:
    task = drawn(folder)
    changes = {"guide": {"strategy": "mixture"}, "arbiter": {"rho": 1.0}}
    return reckless(Agent(task.bind(), resolve("default", task.settings, changes), 0))
