"""Pictures of recorded episodes: they are executed once more, in an environment that draws.

An episode depends on its seed and the actions alone. Each state is compared with the recorded one;
where the two differ, another episode would be drawn, so the pictures end there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import RunError, SerpError
from serp.report.recorded_steps import RecordedSteps, by_interest
from serp.report.tiles import TileSheets
from serp.tasks.bound_task import BoundTask
from serp.training.run import Run
from serp.viz.camera import RGB_ARRAY, Camera

WIDTH: Final = 320
"""Width of a picture, pixels."""
_BEYOND: Final = "Not drawn, to keep the file small and the wait short; --pictures draws more."
_DIFFERS: Final = (
    "Not drawn from here: executed again with the same seed and the same actions, the environment "
    "gives another state than the one recorded."
)


@dataclass
class DrawnScenes:
    """The pictures of a report.

    Attributes:
        sheets: The pictures.
        frames: Number of an episode → its first picture, and how many it has: one for each state.
        notes: Number of an episode → why not all of it is drawn.
        note: Why nothing is drawn; empty if something is.
    """

    sheets: TileSheets = field(default_factory=lambda: TileSheets(WIDTH))
    frames: dict[int, tuple[int, int]] = field(default_factory=dict)
    notes: dict[int, str] = field(default_factory=dict)
    note: str = ""

    def drawn(self, steps: RecordedSteps) -> NDArray[np.bool_]:
        """Return which steps have a picture, `[N]`."""
        found = np.zeros(len(steps), np.bool_)
        for episode, rows in zip(steps.episodes, steps.rows, strict=True):
            found[rows.start : rows.start + self.frames.get(episode.number, (0, 0))[1]] = True
            found[rows.stop :] = False
        return found


def drawn_scenes(
    run: Run,
    steps: RecordedSteps,
    seed_of: Callable[[int], int] | None,
    *,
    most: int,
    most_bytes: int,
    on_picture: Callable[[], None] = lambda: None,
) -> DrawnScenes:
    """Draw episodes, the most interesting ones first, see `by_interest`.

    Args:
        run: The run.
        steps: The steps that the report shows.
        seed_of: Number of an episode, from 0 → seed of the environment; None if it is not known.
        most: Most pictures.
        most_bytes: Bytes of the sheets beyond which nothing more is drawn.
        on_picture: Called after each picture.
    """
    scenes = DrawnScenes()
    sheets = scenes.sheets
    if not most:
        scenes.note = "This report was made without pictures."
        return scenes
    if seed_of is None:
        scenes.note = "No pictures: the recording does not say which seed it was made with."
        return scenes
    rows = dict(zip((each.number for each in steps.episodes), steps.rows, strict=True))
    try:
        with run.environment(RGB_ARRAY) as task:
            if steps["value"].shape[1] != task.actions.size:
                raise RunError("the recording has other actions than the environment")
            for episode in by_interest(steps.episodes):
                number, first = episode.number, len(sheets)
                states, actions = (steps[name][rows[number]] for name in ("state", "action"))
                for picture in _pictures(task, seed_of(number - 1), states, actions):
                    if len(sheets) >= most or sheets.size >= most_bytes:
                        scenes.notes[number] = _BEYOND
                        break
                    sheets.add(picture)
                    on_picture()
                else:
                    if len(sheets) - first <= len(states):
                        scenes.notes[number] = _DIFFERS
                if len(sheets) > first:
                    scenes.frames[number] = (first, len(sheets) - first)
                if len(sheets) >= most or sheets.size >= most_bytes:
                    break
    except (SerpError, ValueError) as error:
        scenes.note = f"No pictures: {str(error).rstrip('.')}."
    for episode in steps.episodes:
        if episode.number not in scenes.frames:
            scenes.notes.setdefault(episode.number, scenes.note or _BEYOND)
    return scenes


def _pictures(
    task: BoundTask, seed: int, states: NDArray[Any], actions: NDArray[Any]
) -> Iterator[NDArray[np.uint8]]:
    """Yield a picture of each state and one of the end, up to a state that is not as recorded."""
    camera = Camera(task)
    observation, info = task.reset(seed)
    for state, action in zip(states, actions.tolist(), strict=True):
        if not np.array_equal(task.ground(observation, info, task.env), state):
            return
        yield camera.take()[-1]
        observation, _, _, _, info = task.step(action)
    yield camera.take()[-1]
