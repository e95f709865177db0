"""What is packed for the page is what comes out, to the digits that are shown."""

from __future__ import annotations

import base64
import gzip
import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from serp.ui.report.scene import TILE, TileSheets
from serp.ui.report.step_data import packed


def test_arrays_come_out_with_four_digits() -> None:
    random = np.random.default_rng(0)
    wide = random.normal(size=1000) * 10.0 ** random.integers(-30, 30, 1000)
    numbers = np.concatenate([wide, [0.0, np.nan, np.inf, -np.inf, 1e300]])
    counts = np.array([0, 1, 255, 65_535, 2**32 - 1], np.uint32)
    text, layout = packed({"numbers": numbers, "counts": counts, "none": np.zeros(0)})
    assert layout == [("numbers", "f4", 1005), ("counts", "u4", 5), ("none", "f4", 0)]
    data = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8)
    first = data[: 4 * 1005].reshape(4, -1).T.copy().view("<f4")[:, 0]
    np.testing.assert_allclose(first[:1004], numbers[:1004], rtol=2e-5)
    assert first[1004] == np.inf  # beyond float32
    assert (data[4 * 1005 :].reshape(4, -1).T.copy().view("<u4")[:, 0] == counts).all()


def test_pictures_of_few_colours_come_out_exactly() -> None:
    random = np.random.default_rng(1)
    colors = random.integers(0, 256, (20, 3), np.uint8)
    still = colors[random.integers(0, 20, (70, 90))]
    pictures = [still.copy() for _ in range(30)]  # more than the colours are taken from
    for k, picture in enumerate(pictures):
        picture[5 : 5 + 2 * k, 10:20] = colors[k % 20]
    sheets = TileSheets(width=200)
    for picture in pictures:
        sheets.add(picture)
    info = sheets.info()
    assert (info["width"], info["height"]) == (90, 70)
    grids = np.cumsum(sheets.grids(), axis=0, dtype=np.uint32)
    drawn = [_sheet(text) for text in sheets.sheets()]
    for picture, grid in zip(pictures, grids, strict=True):
        assert (_picture(info, grid, drawn)[:70, :90] == picture).all()
    assert len(np.unique(grids)) < grids.size / 4


def _sheet(text: str) -> NDArray[np.uint8]:
    with Image.open(io.BytesIO(base64.b64decode(text))) as image:
        return np.asarray(image.convert("RGB"))


def _picture(
    info: dict[str, int], grid: NDArray[np.uint32], sheets: list[NDArray[np.uint8]]
) -> NDArray[np.uint8]:
    """What `page/scene.js` does."""
    whole = np.zeros((info["rows"] * TILE, info["columns"] * TILE, 3), np.uint8)
    for k, number in enumerate(grid.tolist()):
        sheet, at = divmod(number, info["sheet"] ** 2)
        y, x = (TILE * each for each in divmod(at, info["sheet"]))
        to_y, to_x = (TILE * each for each in divmod(k, info["columns"]))
        whole[to_y : to_y + TILE, to_x : to_x + TILE] = sheets[sheet][y : y + TILE, x : x + TILE]
    return whole
