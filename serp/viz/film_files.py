"""Films as files: GIF by Pillow, MP4 (H.264) by the ffmpeg of imageio-ffmpeg."""

from __future__ import annotations

import itertools
import subprocess
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageColor

from serp._util.figures import ACTORS, REFUSED
from serp._util.files import replaced_durably
from serp.errors import RunError, needs_extra
from serp.training.run import Run
from serp.viz.caption import INK
from serp.viz.film import FilmSettings, Frame, OnEpisode, film_of_run

_TICK: Final = 0.01  # unit of durations in a GIF, s
_FEWEST_TICKS: Final = 2  # browsers slow down faster GIFs
_SAMPLES: Final = 60  # frames from which the palette is made
_TRANSPARENT: Final = 255  # index in the palette
_QUALITY: Final = 20  # libx264's constant rate factor: 0 is lossless, 51 is worst


def write_film(
    run: Run, path: Path, settings: FilmSettings, on_episode: OnEpisode | None = None
) -> None:
    """Play a run's policy and write a film of it; a failure leaves no file.

    Args:
        run: The run.
        path: The file, which ends in a key of `WRITERS`; an existing one is replaced.
        settings: How the film is made.
        on_episode: Called at the end of each episode.

    Raises:
        MissingExtra: It is an MP4, and imageio-ffmpeg is not installed.
        RunError: The file cannot be written, or the run not be read.
        SerpError: The task cannot be loaded or draws no pictures, or its environment failed.
    """
    write = WRITERS[path.suffix.lower()]
    with replaced_durably(path) as aside, film_of_run(run, settings, on_episode) as frames:
        write(aside, frames)


def write_gif(path: Path, frames: Iterator[Frame]) -> None:
    """Write an endlessly repeated GIF.

    The palette is taken from the first frames. Pillow stores only the pixels that change, and
    keeps one byte per pixel of every frame until the end.
    """
    first = list(itertools.islice(frames, _SAMPLES))
    palette = _palette([frame.image for frame in first])

    def images() -> Iterator[Image.Image]:
        due, spent = 0.0, 0
        for frame in itertools.chain(first, frames):
            due += frame.seconds / _TICK
            ticks = max(round(due) - spent, _FEWEST_TICKS)
            spent += ticks
            image = frame.image.quantize(palette=palette, dither=Image.Dither.NONE)
            image.info["duration"] = 10 * ticks
            yield image

    rest = images()
    next(rest).save(
        path,
        "GIF",
        save_all=True,
        append_images=rest,
        loop=0,
        palette=bytes(palette.getpalette() or ()),
        optimize=True,
        transparency=_TRANSPARENT,
        disposal=1,
    )


def _palette(images: list[Image.Image]) -> Image.Image:
    """Return an image whose palette fits pictures and captions, even marks that come later."""
    red, white = (np.array(ImageColor.getrgb(name)) for name in (REFUSED, INK))
    shades = [red + (white - red) * k // 4 for k in range(5)]  # for smooth letters
    fixed = np.concatenate([*shades, *(ImageColor.getrgb(name) for name in ACTORS.values())])
    sample = np.concatenate([np.asarray(image) for image in images[:: _SAMPLES // 8]])
    free = _TRANSPARENT - len(fixed) // 3
    seen = Image.fromarray(sample).quantize(free, Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([*fixed.tolist(), *seen[: 3 * free]])
    return palette


def write_mp4(path: Path, frames: Iterator[Frame]) -> None:
    """Write an MP4.

    The duration of the first frame, at most 1 s, gives the frame rate; longer frames are repeated.
    """
    with needs_extra("watch", "writing MP4"):
        from imageio_ffmpeg import get_ffmpeg_exe
    try:
        ffmpeg = get_ffmpeg_exe()
    except RuntimeError as error:
        raise RunError(f"MP4 needs ffmpeg, and none was found: {error}") from error
    first = next(frames)
    rate = max(Fraction(1.0 / first.seconds).limit_denominator(1000), Fraction(1))
    width, height = first.image.size
    command = [
        ffmpeg, "-loglevel", "error", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate),
        "-i", "pipe:0",
        "-c:v", "libx264", "-crf", str(_QUALITY), "-pix_fmt", "yuv420p",
        "-movflags", "+faststart", "-f", "mp4", f"file:{path}",
    ]  # fmt: skip
    due, count = 0.0, 0
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None and process.stderr is not None
        try:
            for frame in itertools.chain([first], frames):
                due += frame.seconds * float(rate)
                for _ in range(max(1, round(due) - count)):
                    process.stdin.write(frame.image.tobytes())
                    count += 1
            process.stdin.close()
        except BrokenPipeError:
            pass  # it ended early, and says why
        why = process.stderr.read().decode(errors="replace").strip()
    if process.returncode:
        raise RunError(f"ffmpeg could not write {path}: {why}")


WRITERS: Final[dict[str, Callable[[Path, Iterator[Frame]], None]]] = {
    ".gif": write_gif,
    ".mp4": write_mp4,
}
"""Suffix of a film → its writer."""
