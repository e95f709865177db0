"""Pictures as grids of tiles: equal tiles are stored once, whatever picture they are from.

Drawn scenes change in few places, and return to what was there before. Measured on soccer with
320 × 277 pixels: 0.45 kB a picture, where a WebP of each takes 2.4 kB; and any picture is drawn at
once, without those before it.
"""

from __future__ import annotations

import base64
import io
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from serp.errors import needs_extra

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
