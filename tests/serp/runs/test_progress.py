"""The display of a training."""

import io
import re
from types import SimpleNamespace
from typing import Any

import pytest

from serp.runs.progress import Progress
from serp.runs.trainer import Budget


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


class Training(SimpleNamespace):
    """What a display reads of a trainer; it is also the clock."""

    now = 100.0

    def to(self, episode: int, env_steps: int, wall_time: float = 0.0) -> None:
        self.episode, self.env_steps = episode, env_steps
        self.wall_time = wall_time
        self.tally.executed["planner"] = env_steps // 4
        self.recent = [19.0, 20.0, 21.0, 25.0, 26.0, 27.0] if episode else []


@pytest.fixture
def training() -> Training:
    training = Training(
        tally=SimpleNamespace(executed={"planner": 0}, unsafe_executed=0),
    )
    training.to(0, 0)
    return training


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")


def display(training: Training, stream: Any, *, quiet: bool = False, **limits: int) -> Progress:
    return Progress(
        training,  # type: ignore[arg-type]
        Budget(**limits),
        "[cart] → runs/x",
        quiet=quiet,
        stream=stream,
        clock=lambda: training.now,
    )


def shown(stream: io.StringIO) -> str:
    return re.sub(r"\x1b\[[\d;?]*\w", "", stream.getvalue())


@pytest.mark.parametrize(("kind", "refreshes"), [(io.StringIO, 6), (Terminal, 101)])
def test_a_refresh_comes_every_five_seconds_on_a_pipe_and_five_times_a_second_on_a_terminal(
    training: Training, kind: type[io.StringIO], refreshes: int
) -> None:
    """At once, regularly, and at the end."""
    stream = kind()
    with display(training, stream) as progress:
        for step in range(1, 2101):
            training.now += 0.01
            training.to(step // 50, step, step * 0.01)
            progress.refresh()
    assert shown(stream).count("unsafe 0") == pytest.approx(refreshes, abs=refreshes // 10)
    if kind is io.StringIO:
        assert stream.getvalue() == shown(stream) and "\r" not in stream.getvalue()
        assert stream.getvalue().splitlines()[-1] == (
            "step 2,100, return 23 (rising), planner acts 25 %, unsafe 0"
        )


@pytest.mark.parametrize("kind", [Terminal, io.StringIO])
@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_shows_nothing_but_answers_on_a_terminal(
    training: Training, kind: type[io.StringIO], quiet: bool
) -> None:
    stream = kind()
    with display(training, stream, quiet=quiet) as progress:
        training.to(1, 10)
        progress.refresh()
        progress.note("went back to [the] previous checkpoint")
        progress.answer("Ctrl-C: finishing the episode")
    text = shown(stream)
    assert ("went back to [the] previous checkpoint\n" in text) is not quiet
    assert ("Ctrl-C: finishing the episode\n" in text) is (kind is Terminal or not quiet)
    assert ("step 10" in text) is not quiet


@pytest.mark.parametrize("base", [Terminal, io.StringIO])
def test_a_reader_that_goes_away_does_not_end_the_run(
    training: Training, base: type[io.StringIO]
) -> None:
    class Broken(base):  # type: ignore[misc, valid-type]
        broken = False

        def write(self, text: str) -> int:
            if self.broken:
                raise BrokenPipeError
            return int(super().write(text))

    stream = Broken()
    with display(training, stream) as progress:
        stream.broken = True
        training.to(1, 10)
        progress.refresh()
        progress.note("warning")
    stream.broken = False
    closed = io.StringIO()
    closed.close()
    with display(training, closed) as progress:
        progress.note("warning")
