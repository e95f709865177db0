"""Pictures of recorded episodes: they are executed once more, in an environment that draws.

An episode depends on its seed and the actions alone. Each state is compared with the recorded one;
where the two differ, another episode would be drawn, so the pictures end there.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import RunError, SerpError, needs_extra
from serp.runs.run import Run
from serp.tasks.task import BoundTask
from serp.ui.pictures.film import RGB_ARRAY, Camera
from serp.ui.report.recorded_steps import RecordedSteps, by_interest

with needs_extra("report", "a report of a run"):
    from PIL import Image

TILE: Final = 16
"""Edge of a tile, pixels."""
_SIDE: Final = 64
"""Tiles along the edge of a sheet."""
_COLORS: Final = 128
"""Colours of all pictures; they are those of the first ones."""
_SAMPLE: Final = 24
"""Pictures that the colours are taken from."""
_TYPICAL: Final = 40.0
"""Bytes of a tile in a sheet, until there is one."""


class TileSheets:
    """Collects pictures of one size; the first ones decide on the colours of all.

    Args:
        width: Largest width of a picture, pixels; larger ones are made smaller.
    """

    def __init__(self, width: int) -> None:
        self._most = width
        self._count = 0
        self._shape: tuple[int, ...] = ()
        self._waiting: list[Image.Image] = []
        self._palette: Image.Image | None = None
        self._known: dict[bytes, int] = {}
        self._unsaved: list[bytes] = []
        self._grids: list[NDArray[np.uint32]] = []
        self._sheets: list[bytes] = []

    def __len__(self) -> int:
        return self._count

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Add a picture `(height, width, 3)`.

        Raises:
            ValueError: It has another size than the ones before.
        """
        if not self._count:
            self._shape = picture.shape
            tall, wide = picture.shape[:2]
            self.width = min(self._most, wide)
            self.height = max(1, round(tall * self.width / wide))
            self.columns, self.rows = -(-self.width // TILE), -(-self.height // TILE)
        if picture.shape != self._shape:
            raise ValueError(f"pictures of {self._shape} and of {picture.shape} pixels")
        image = Image.fromarray(picture)
        size = (self.width, self.height)
        if image.size != size:
            image = image.resize(size, Image.Resampling.HAMMING)
        self._count += 1
        self._waiting.append(image)
        if self._palette is not None or len(self._waiting) == _SAMPLE:
            self._cut()

    def _cut(self) -> None:
        """Cut what waits into tiles."""
        if not self._waiting:
            return
        if self._palette is None:
            sample = np.concatenate([np.asarray(each) for each in self._waiting])
            self._palette = Image.fromarray(sample).quantize(_COLORS, Image.Quantize.MEDIANCUT)
        for image in self._waiting:
            indices = image.quantize(palette=self._palette, dither=Image.Dither.NONE)
            full = np.zeros((self.rows * TILE, self.columns * TILE), np.uint8)
            full[: self.height, : self.width] = np.asarray(indices)
            tiles = full.reshape(self.rows, TILE, self.columns, TILE).swapaxes(1, 2)
            grid = [self._number(tile.tobytes()) for tile in tiles.reshape(-1, TILE * TILE)]
            self._grids.append(np.array(grid, np.uint32))
        self._waiting = []

    @property
    def size(self) -> int:
        """Bytes of the sheets that are full, and about those of the last one."""
        full = sum(map(len, self._sheets))
        saved = len(self._known) - len(self._unsaved)
        return full + round((full / saved if saved else _TYPICAL) * len(self._unsaved))

    def grids(self) -> NDArray[np.uint32]:
        """Return the tile at each place of each picture, `[pictures, rows × columns]`.

        Each less that of the picture before, modulo 2³²: most are 0 then.
        """
        self._cut()
        every = np.stack(self._grids)
        changes: NDArray[np.uint32] = np.diff(every, axis=0, prepend=np.uint32(0))
        return changes

    def sheets(self) -> list[str]:
        """Return the sheets, each a WebP without loss in base64."""
        self._cut()
        last = [self._drawn(self._unsaved)] if self._unsaved else []
        return [base64.b64encode(sheet).decode("ascii") for sheet in (*self._sheets, *last)]

    def info(self) -> dict[str, Any]:
        """Return what the page needs to draw them, as JSON values."""
        return {
            "width": self.width, "height": self.height, "columns": self.columns, "rows": self.rows,
            "tile": TILE, "sheet": _SIDE,
        }  # fmt: skip

    def _number(self, tile: bytes) -> int:
        number = self._known.get(tile)
        if number is None:
            number = self._known[tile] = len(self._known)
            self._unsaved.append(tile)
            if len(self._unsaved) == _SIDE * _SIDE:
                self._sheets.append(self._drawn(self._unsaved))
                self._unsaved = []
        return number

    def _drawn(self, tiles: list[bytes]) -> bytes:
        rows = -(-len(tiles) // _SIDE)
        sheet = np.zeros((rows * _SIDE, TILE * TILE), np.uint8)
        sheet[: len(tiles)] = np.frombuffer(b"".join(tiles), np.uint8).reshape(-1, TILE * TILE)
        pixels = sheet.reshape(rows, _SIDE, TILE, TILE).swapaxes(1, 2)
        image = Image.fromarray(np.ascontiguousarray(pixels.reshape(rows * TILE, _SIDE * TILE)))
        assert self._palette is not None
        image.putpalette(self._palette.getpalette() or [])
        buffer = io.BytesIO()
        image.convert("RGB").save(buffer, "WEBP", lossless=True, quality=80)
        return buffer.getvalue()


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
