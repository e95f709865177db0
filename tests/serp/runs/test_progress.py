"""The display of a training."""

import io
from types import SimpleNamespace

import pytest

from serp.runs.progress import Progress
from serp.runs.run_config import Budget


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self):
        return True


@pytest.mark.parametrize("base", [Terminal, io.StringIO])
def test_a_reader_that_goes_away_does_not_end_the_run(base, monkeypatch):
    """Nor does a stream that is closed."""
    monkeypatch.setenv("TERM", "xterm")

    class Broken(base):
        broken = False

        def write(self, text):
            if self.broken:
                raise BrokenPipeError
            return super().write(text)

    tally = SimpleNamespace(executed={"planner": 0}, unsafe_executed=0)
    training = SimpleNamespace(tally=tally, episode=0, env_steps=0)
    training.wall_time, training.recent = 0.0, [19.0, 25.0]
    stream, closed = Broken(), io.StringIO()
    with Progress(training, Budget(), "[cart] → runs/x", stream=stream) as progress:
        stream.broken, training.env_steps = True, 10
        progress.refresh()
        progress.note("warning")
    stream.broken = False
    closed.close()
    with Progress(training, Budget(), "", stream=closed) as progress:
        progress.note("warning")
