"""Writes frames as a GIF one by one, so that memory holds only the current ones.

Pillow's `save_all` would hold all frames until it saves; its documented `GifImagePlugin.getdata`
encodes one. All frames share one palette, and a frame stores only the pixels that changed, so that
files stay small.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np
from numpy.typing import NDArray
from PIL import GifImagePlugin, Image, ImageColor

from serp.viz.caption import PAIRS
from serp.viz.film import Frame

FASTEST: Final = 50.0
"""Largest number of frames per second; browsers slow down faster GIFs."""
_TICKS = 100  # per second
_UNCHANGED = 255  # index in the palette that means "unchanged"
_SAMPLES = 60  # frames from which the palette is made
_SHADES = 3  # colours between a background and the text on it
_LONGEST = 65_535  # longest duration of a frame, ticks


def write_gif(path: Path, frames: Iterable[Frame]) -> int:
    """Write an endlessly repeated GIF; return the number of its frames.

    The palette is taken from the first frames, and from the colours of captions.

    Args:
        path: The file.
        frames: At least one.

    Raises:
        OSError: The file cannot be written.
    """
    rest = iter(frames)
    first = list(itertools.islice(rest, _SAMPLES))
    palette = _palette([frame.image for frame in first])
    count = 0
    with open(path, "wb") as file:
        file.write(_head(first[0].image.size, palette))
        shown: NDArray[np.uint8] | None = None
        for frame, ticks in _timed(itertools.chain(first, rest)):
            pixels = np.asarray(frame.image.quantize(palette=palette, dither=Image.Dither.NONE))
            _write_frame(file, pixels, shown, ticks, palette)
            shown = pixels
            count += 1
        file.write(b";")
    return count


def _timed(frames: Iterable[Frame]) -> Iterator[tuple[Frame, int]]:
    """Return frames with whole ticks that add up to their seconds."""
    due, spent = 0.0, 0
    for frame in frames:
        due += frame.seconds * _TICKS
        ticks = min(max(round(due) - spent, round(_TICKS / FASTEST)), _LONGEST)
        spent += ticks
        yield frame, ticks


def _head(size: tuple[int, int], palette: Image.Image) -> bytes:
    colours = bytes(palette.getpalette() or ()).ljust(768, b"\0")
    screen = b"".join(length.to_bytes(2, "little") for length in size)
    endlessly = b"!\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00"
    # 0xf7: a global palette of 256 colours
    return b"GIF89a" + screen + b"\xf7\x00\x00" + colours + endlessly


def _write_frame(
    file: BinaryIO,
    pixels: NDArray[np.uint8],
    shown: NDArray[np.uint8] | None,
    ticks: int,
    palette: Image.Image,
) -> None:
    """Write the pixels that differ from the previous frame."""
    top = left = 0
    if shown is not None:
        changed = pixels != shown
        rows, columns = changed.any(axis=1).nonzero()[0], changed.any(axis=0).nonzero()[0]
        top, bottom = (int(rows[0]), int(rows[-1]) + 1) if rows.size else (0, 1)
        left, right = (int(columns[0]), int(columns[-1]) + 1) if columns.size else (0, 1)
        part = (slice(top, bottom), slice(left, right))
        pixels = np.where(changed[part], pixels[part], np.uint8(_UNCHANGED))
    image = Image.fromarray(np.ascontiguousarray(pixels))
    image.putpalette(palette.getpalette() or [])
    for data in GifImagePlugin.getdata(
        image, (left, top), duration=10 * ticks, transparency=_UNCHANGED, disposal=1
    ):
        file.write(data)


def _palette(images: list[Image.Image]) -> Image.Image:
    """Return an image whose palette fits captions and pictures; the last index stays free."""
    fixed = [colour for pair in PAIRS for colour in _shades(*pair)]
    fixed = list(dict.fromkeys(fixed))
    step = max(1, len(images) // 8)
    sample = np.concatenate([np.asarray(image) for image in images[::step]])
    free = _UNCHANGED - len(fixed)
    seen = Image.fromarray(sample).quantize(free, Image.Quantize.MAXCOVERAGE)
    colours = [value for colour in fixed for value in colour] + (seen.getpalette() or [])[
        : 3 * free
    ]
    palette = Image.new("P", (1, 1))
    # Unused entries repeat the first colour, so that no pixel is matched to the last.
    palette.putpalette((colours + colours[:3] * 256)[:768])
    return palette


def _shades(background: str, writing: str) -> list[tuple[int, ...]]:
    """Return two colours and the shades between them, for smooth letters."""
    one, other = (np.array(ImageColor.getrgb(name)) for name in (background, writing))
    shares = np.linspace(0.0, 1.0, 2 + _SHADES)
    return [tuple(np.rint(one + share * (other - one)).astype(int).tolist()) for share in shares]
