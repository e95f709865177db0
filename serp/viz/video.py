"""Writes frames as an MP4 (H.264), which every browser and player shows."""

from __future__ import annotations

import contextlib
import itertools
import subprocess
import tempfile
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import IO

from serp.errors import MissingExtra, RunError
from serp.viz.film import Frame

_QUALITY = 20  # libx264's constant rate factor: 0 is lossless, 51 is worst


def find_ffmpeg() -> str:
    """Return the path of the ffmpeg executable of imageio-ffmpeg.

    Raises:
        MissingExtra: Imageio-ffmpeg is not installed.
        RunError: It has none for this machine.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        raise MissingExtra("writing MP4", "watch") from None
    try:
        return str(get_ffmpeg_exe())
    except RuntimeError as error:
        raise RunError(f"MP4 needs ffmpeg, and none was found: {error}") from error


def write_mp4(path: Path, frames: Iterable[Frame]) -> int:
    """Write an MP4; return the number of its frames.

    The duration of the first frame, at most 1 s, gives the frame rate; longer frames are repeated.

    Args:
        path: The file, with any suffix.
        frames: At least one, of even width and height.

    Raises:
        MissingExtra: Imageio-ffmpeg is not installed.
        RunError: Ffmpeg failed.
    """
    ffmpeg = find_ffmpeg()
    rest = iter(frames)
    first = next(rest)
    rate = max(Fraction(1.0 / first.seconds).limit_denominator(1000), Fraction(1))
    width, height = first.image.size
    command = [
        ffmpeg, "-loglevel", "error", "-nostdin", "-y",
        "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(rate),
        "-i", "pipe:0",
        "-c:v", "libx264", "-crf", str(_QUALITY), "-pix_fmt", "yuv420p",
        "-movflags", "+faststart", "-f", "mp4", f"file:{path}",
    ]  # fmt: skip
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said
        )
        assert process.stdin is not None
        count = 0
        try:
            count = _feed(process.stdin, itertools.chain([first], rest), float(rate))
            process.stdin.close()
            process.wait()
        except BrokenPipeError:  # it ended early; the reason is read below
            process.wait()
        finally:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
            if process.poll() is None:
                process.kill()
                process.wait()
        status = process.returncode
        if status or not count:
            said.seek(0)
            why = said.read().decode(errors="replace").strip() or f"it ended with {status}"
            raise RunError(f"ffmpeg could not write {path}: {why}")
    return count


def _feed(pipe: IO[bytes], frames: Iterable[Frame], rate: float) -> int:
    """Send frames, repeated for their duration; return the number sent."""
    due, count = 0.0, 0
    for frame in frames:
        due += frame.seconds * rate
        data = frame.image.tobytes()
        for _ in range(max(1, round(due) - count)):
            pipe.write(data)
            count += 1
    return count
