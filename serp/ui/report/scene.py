"""Pictures of recorded episodes: they are executed once more, in an environment that draws.

An episode depends on its seed and the actions alone. Each state is compared with the recorded one;
where the two differ, another episode would be drawn, so the pictures end there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from serp.errors import RunError, SerpError, needs_extra
from serp.runs.run import Run
from serp.tasks.environment import BoundTask
from serp.ui.report.recorded_steps import RecordedSteps, by_interest

with needs_extra("report", "a report of a run"):
    from serp.ui.pictures.camera import Camera, webp


@dataclass
class DrawnScenes:
    """The pictures of a report, each a WebP.

    `frames` has, by episode, its first picture and how many it has, one for each state; `notes` why
    not all of it is drawn.
    """

    pictures: list[bytes] = field(default_factory=list)
    frames: dict[int, tuple[int, int]] = field(default_factory=dict)
    notes: dict[int, str] = field(default_factory=dict)

    def drawn(self, steps: RecordedSteps) -> NDArray[np.bool_]:
        """Return which steps have a picture, `[N]`."""
        drawn = np.zeros(len(steps), np.bool_)
        for episode, rows in zip(steps.episodes, steps.rows, strict=True):
            count = min(len(episode), self.frames.get(episode.number, (0, 0))[1])
            drawn[rows.start : rows.start + count] = True
        return drawn


def drawn_scenes(
    run: Run,
    steps: RecordedSteps,
    seed_of: Callable[[int], int] | None,
    *,
    most: int,
    on_picture: Callable[[], None],
) -> DrawnScenes:
    """Draw episodes, the most interesting ones first, see `by_interest`; at most `most` pictures.

    `seed_of` returns the seed of an episode, by its number from 0; None if it is not known.
    """
    differs = (
        "Not drawn from here: executed again with the same seed and the same actions, the "
        "environment gives another state than the one recorded."
    )
    omitted = "Not drawn, to keep the file small and the wait short; --pictures draws more."
    scenes, why, room = DrawnScenes(), omitted, 4_500_000  # bytes
    pictures = scenes.pictures
    rows = dict(zip((each.number for each in steps.episodes), steps.rows, strict=True))
    try:
        if most and seed_of is None:
            raise RunError("the recording does not say which seed it was made with")
        if most and seed_of is not None:
            with run.environment("rgb_array") as task:
                if steps["value"].shape[1] != task.actions.size:
                    raise RunError("the recording has other actions than the environment")
                for episode in by_interest(steps.episodes):
                    number, first = episode.number, len(pictures)
                    states, actions = (steps[name][rows[number]] for name in ("state", "action"))
                    for picture in _pictures(task, seed_of(number - 1), states, actions):
                        pictures.append(webp(picture, 320))
                        room -= len(pictures[-1])
                        on_picture()
                        if len(pictures) >= most or room <= 0:
                            break
                    full = len(pictures) >= most or room <= 0
                    if len(pictures) - first <= len(states):
                        scenes.notes[number] = omitted if full else differs
                    if len(pictures) > first:
                        scenes.frames[number] = (first, len(pictures) - first)
                    if full:
                        break
    except SerpError as error:
        why = f"No pictures: {str(error).rstrip('.')}."
    for episode in steps.episodes:
        if episode.number not in scenes.frames:
            scenes.notes.setdefault(episode.number, why)
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
