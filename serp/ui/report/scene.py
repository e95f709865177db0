"""Pictures of recorded episodes: they are executed once more, in an environment that draws.

An episode depends on its seed and the actions alone. Each state is compared with the recorded one;
where the two differ, another episode would be drawn, so the pictures end there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from serp.errors import RunError, SerpError, needs_extra
from serp.runs.run import Run
from serp.ui.report.recorded_steps import RecordedEpisode, RecordedSteps, by_interest

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


def drawn_scenes(
    run: Run,
    steps: RecordedSteps,
    seed_of: Callable[[int], int],
    *,
    most: int,
    on_picture: Callable[[], None],
) -> DrawnScenes:
    """Draw episodes, the most interesting ones first, see `by_interest`; at most `most` pictures.

    `seed_of` returns the seed of an episode, by its number from 0.
    """
    scenes, room = DrawnScenes(), 4_500_000  # bytes
    why = "The episode is not drawn, to keep the file small; --pictures draws more."
    try:
        for episode, picture in _pictures(run, steps, seed_of) if most else ():
            if picture is None:
                scenes.notes[episode.number] = (
                    "The rest is not drawn: when the same actions were repeated with the same "
                    "seed, the environment did not reach the recorded state."
                )
                continue
            first, count = scenes.frames.get(episode.number, (len(scenes.pictures), 0))
            scenes.frames[episode.number] = (first, count + 1)
            scenes.pictures.append(webp(picture, 320))
            room -= len(scenes.pictures[-1])
            on_picture()
            if len(scenes.pictures) >= most or room <= 0:
                break
    except SerpError as error:
        why = f"No pictures: {str(error).rstrip('.')}."
    for episode in steps.episodes:
        if scenes.frames.get(episode.number, (0, 0))[1] <= len(episode):
            scenes.notes.setdefault(episode.number, why)
    return scenes


def _pictures(
    run: Run, steps: RecordedSteps, seed_of: Callable[[int], int]
) -> Iterator[tuple[RecordedEpisode, NDArray[np.uint8] | None]]:
    """Yield a picture of each state of each episode and one of its end.

    None stands for the rest of an episode from a state on that is not as recorded.
    """
    with run.environment("rgb_array") as task:
        if steps["value"].shape[1] != task.actions.size:
            raise RunError("the recording has other actions than the environment")
        for episode in by_interest(steps.episodes):
            states, actions = (steps[name][episode.rows] for name in ("state", "action"))
            camera, (observation, info) = Camera(task), task.reset(seed_of(episode.number - 1))
            for state, action in zip(states, actions.tolist(), strict=True):
                if not np.array_equal(task.ground(observation, info, task.env), state):
                    yield episode, None
                    break
                yield episode, camera.take()[-1]
                observation, _, _, _, info = task.step(action)
            else:
                yield episode, camera.take()[-1]
