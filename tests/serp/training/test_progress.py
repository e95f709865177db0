from __future__ import annotations

import dataclasses
import io
import re
import subprocess
import sys

import pytest

from serp.training.budget import Budget
from serp.training.progress import Progress, ProgressStats
from serp.training.progress_display import open_progress

TEN = ProgressStats(10, 1000, 23.0, 21.4, 0.12, 3, 0)


class Terminal(io.StringIO):
    encoding = "utf-8"

    def isatty(self):
        return True


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture(autouse=True)
def plain_environment(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "80")
    for name in ("FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    defaults = (None, None, None, clock)
    monkeypatch.setattr(Progress.__init__, "__defaults__", defaults)
    return clock


def run(stream, clock, seconds, *, step=0.01, **options):
    """A loop of `seconds` at 1/step env steps a second and an episode every 50; what was shown."""
    steps = 0
    with open_progress(stream=stream, **options) as progress:
        for steps in range(1, round(seconds / step) + 1):
            clock.now += step
            stats = ProgressStats(
                steps // 50, steps, 23.0, 21.4, 0.12, 3, 0, wall_time=steps * step
            )
            if progress.due() or steps % 50 == 0:
                progress.update(stats)
    return stream.getvalue(), steps


def test_a_pipe_gets_plain_lines_at_a_sensible_rate(clock):
    text, _ = run(io.StringIO(), clock, 21)
    lines = text.splitlines()
    assert "\x1b" not in text and "\r" not in text
    assert len(lines) == 6  # at once, after 5, 10, 15 and 20 seconds, and at the end
    assert lines[0].startswith("episode 0, step 1, return 23.0 (mean of ≤ 20: 21.4), ρ 0.12")
    assert "vetoes 3, unsafe executed 0" in lines[0] and "left" not in lines[0]
    assert "100 steps/s" in lines[2]


def test_the_last_line_tells_the_end_even_of_the_shortest_run():
    stream = io.StringIO()
    with open_progress(stream=stream) as progress:
        progress.update(ProgressStats(1, 10))
        progress.update(ProgressStats(2, 20))
    assert [line.split(",")[0] for line in stream.getvalue().splitlines()] == [
        "episode 1",
        "episode 2",
    ]


def test_nothing_is_told_of_a_run_that_did_nothing():
    stream = io.StringIO()
    with pytest.raises(ZeroDivisionError), open_progress(stream=stream):
        raise ZeroDivisionError
    assert stream.getvalue() == ""


@pytest.mark.parametrize(
    ("budget", "left"),
    [
        ({"env_steps": 10_000}, "1 min 20 s left"),
        ({"episodes": 100}, "30.0 s left"),
        ({"episodes": 100, "env_steps": 10_000}, "30.0 s left"),  # whichever is spent first
        ({"env_steps": 10}, "0.0 s left"),
        ({}, None),
    ],
)
def test_time_left_counts_down_to_the_budget(clock, budget, left):
    text, steps = run(io.StringIO(), clock, 20, budget=Budget(**budget))
    assert steps == 2000
    last = text.splitlines()[-1]
    assert last.endswith(left) if left else "left" not in last


def test_time_left_goes_by_the_speed_since_a_run_was_resumed(clock):
    stream = io.StringIO()
    start = ProgressStats(500, 100_000)
    with open_progress(stream=stream, budget=Budget(env_steps=101_000), start=start) as progress:
        clock.now += 60  # compiling
        progress.update(ProgressStats(500, 100_010, wall_time=1000.0))
        clock.now += 50  # 40 seconds of it compiling
        progress.update(ProgressStats(501, 100_210, wall_time=1010.0))
    assert "99 steps/s, 39.5 s left" in stream.getvalue()


def test_time_left_goes_by_the_last_half_minute_and_speed_by_the_whole_training(clock):
    stream = io.StringIO()
    with open_progress(stream=stream, budget=Budget(env_steps=102_000)) as progress:
        for second in range(1, 201):
            clock.now += 1
            steps = 1000 * min(second, 100) + 10 * max(second - 100, 0)
            progress.update(ProgressStats(0, steps, wall_time=float(second)))
    assert stream.getvalue().splitlines()[-1].endswith("505 steps/s, 1 min 40 s left")


@pytest.mark.parametrize("width", [80, 40])
def test_a_terminal_gets_a_panel_with_every_number(monkeypatch, clock, width):
    monkeypatch.setenv("COLUMNS", str(width))
    stream = Terminal()
    budget = Budget(env_steps=4000)
    with open_progress(stream=stream, title="[cart] → runs/x", budget=budget) as progress:
        progress.update(dataclasses.replace(TEN, episode=0, env_steps=1))
        clock.now += 9.99
        progress.update(dataclasses.replace(TEN, wall_time=10.0))
    last = stream.getvalue().split("╭")[-1]
    for text in ("[cart] → runs/x", "10", "1,000/4,000", "23.0", "21.4", "0.12", "100", "30.0 s"):
        assert text in last
    for label in ("episode", "step", "return", "mean of ≤ 20", "vetoes", "unsafe executed", "ρ"):
        assert label in last
    assert "25 %" in last
    assert stream.getvalue().count("\x1b[?25l") == stream.getvalue().count("\x1b[?25h") == 1


def test_a_terminal_is_drawn_five_times_a_second(clock):
    text, _ = run(Terminal(), clock, 5, step=0.001)
    assert 22 <= text.count("╭") <= 28


def test_the_cursor_comes_back_after_an_error():
    stream = Terminal()
    with pytest.raises(KeyboardInterrupt), open_progress(stream=stream) as progress:
        progress.update(TEN)
        raise KeyboardInterrupt
    assert stream.getvalue().rstrip().endswith("\x1b[?25h")


def test_a_dumb_terminal_gets_plain_lines_and_a_stream_without_greek_the_word(monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    stream = Terminal()
    with open_progress(stream=stream) as progress:
        progress.update(TEN)
    assert "\x1b" not in stream.getvalue() and "episode 10" in stream.getvalue()
    raw = io.BytesIO()
    with open_progress(stream=io.TextIOWrapper(raw, encoding="ascii")) as progress:
        progress.update(TEN)
        progress.note("größer")
        assert b"rho 0.12" in raw.getvalue() and b"gr??er" in raw.getvalue()


@pytest.mark.parametrize("stream", [Terminal(), io.StringIO()])
def test_quiet_shows_nothing(stream):
    with open_progress(stream=stream, quiet=True) as progress:
        assert not progress.due()
        progress.update(TEN)
        progress.note("warning")
    assert stream.getvalue() == ""


@pytest.mark.parametrize("kind", [Terminal, io.StringIO])
def test_notes_stay_on_the_screen(kind):
    stream = kind()
    with open_progress(stream=stream) as progress:
        progress.update(TEN)
        progress.note("went back to [the] previous checkpoint")
    assert "went back to [the] previous checkpoint\n" in stream.getvalue()


def test_prints_meant_for_a_file_reach_it(capsys):
    stream = Terminal()
    with open_progress(stream=stream) as progress:
        progress.update(TEN)
        print("a result")
    assert capsys.readouterr().out == "a result\n" and "a result" not in stream.getvalue()


@pytest.mark.parametrize("base", [Terminal, io.StringIO])
def test_a_reader_that_goes_away_does_not_end_the_run(base):
    class Broken(base):
        broken = False

        def write(self, text):
            if self.broken:
                raise BrokenPipeError
            return super().write(text)

    stream = Broken()
    with open_progress(stream=stream) as progress:
        stream.broken = True
        progress.update(TEN)
        progress.note("warning")
        assert not progress.due()
    stream.broken = False


def test_rich_is_not_imported_for_plain_lines():
    code = (
        "import sys\n"
        "from serp.training.progress import ProgressStats\n"
        "from serp.training.progress_display import open_progress\n"
        "with open_progress() as p: p.update(ProgressStats(1, 2))\n"
        "assert 'rich' not in sys.modules\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, encoding="utf-8"
    )
    assert done.stdout == "" and done.stderr.startswith("episode 1, step 2, vetoes 0")


@pytest.mark.parametrize("quiet", [True, False])
def test_a_key_is_answered_at_a_terminal_even_where_the_display_is_quiet(quiet):
    stream = Terminal()
    with open_progress(stream=stream, quiet=quiet) as progress:
        progress.answer("Ctrl-C: finishing the episode")
    assert "Ctrl-C: finishing the episode\n" in stream.getvalue()


def test_a_quiet_display_answers_nobody_where_nobody_sits():
    pipe, gone = io.StringIO(), Terminal()
    gone.close()
    for stream in (pipe, gone):
        with open_progress(stream=stream, quiet=True) as progress:
            progress.answer("Ctrl-C: finishing the episode")
    assert pipe.getvalue() == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_games_are_shown_where_they_are_what_ends_the_training(terminal: bool) -> None:
    stream = Terminal() if terminal else io.StringIO()
    with open_progress(stream=stream, budget=Budget(units=28), unit="game") as progress:
        progress.update(dataclasses.replace(TEN, units=7))
    plain = re.sub(r"\x1b\[[\d;?]*\w", "", stream.getvalue())
    assert re.search(r"game\s+7/28", plain)
