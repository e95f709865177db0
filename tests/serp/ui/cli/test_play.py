"""`serp play`."""

import os
import select
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from serp.ui.root import serp


def typed(lines, *arguments, expect=0):
    result = CliRunner().invoke(serp, ["play", *arguments], input=lines)
    assert result.exit_code == expect, result.output
    return result.output


def test_a_world_slips_and_mistakes_have_a_line(walk):
    shown = typed("1\n", "walk.pddl", "--slip=0.99", "--set=planner.name=lookahead")
    assert "step 0: go home shop slips: go home field happens instead" in shown
    assert "   unsafe by action go home field. [walk.pddl:11 `(unsafe)`]" in shown
    shown = typed("field = 3", "walk.pddl", expect=1)
    assert "line 1: change: unknown fluent `field`" in shown
    assert "line 2: there is no action or command `gp`" in typed("s\ngp", "walk.pddl", expect=1)
    for line in ("u 99999999999", "p 0", "1 * 10001"):
        shown = typed(line, "walk.pddl", expect=1)
        assert "line 1: expected a number from 1 to 10,000, not " in shown


def test_a_situation_is_saved_as_a_scenario_that_holds(run, walk):
    mined = typed("1\nsave mines wherever one looks", "walk.pddl", "--state=mined shop=true")
    assert "walk.scenarios: the scenario `mines wherever one looks` is written\n" in mined
    shown = typed("1\nsave at the shop\n", "walk.pddl")
    assert "walk.scenarios: the scenario `at the shop` is written\n" in shown
    written = Path("walk.scenarios").read_text()
    assert "  (mined shop)\n" in written.split("scenario")[1]
    assert "scenario at the shop\n  ; played by hand, after 1 step\n  not (at home)\n" in written
    assert "2 passed" in run("test", "walk.pddl").stdout
    told = typed("save a", "cartpole", expect=1)
    assert "no scenario is saved beside it; play a copy of the file" in told


@pytest.mark.skipif(os.name == "nt", reason="there are no pseudo-terminals")
def test_on_a_terminal_an_empty_line_repeats_and_a_mistake_ends_nothing(walk):
    import pty

    here, there = pty.openpty()
    command = [sys.executable, "-m", "serp", "play", "walk.pddl"]
    process = subprocess.Popen(command, stdin=there, stdout=there, stderr=there)
    os.close(there)
    os.write(here, b"1\n\nwalked = 7\nzz\nq\n")
    shown = b""
    try:
        while b"`zz`" not in shown:
            assert select.select([here], [], [], 20)[0], shown
            shown += os.read(here, 4096)
        assert process.wait(20) == 0
    finally:
        process.kill()
        os.close(here)
    assert b"1 go home shop  2 go home field >" in shown
    assert b"step 1: go home shop is not applicable, so nothing is done" in shown
    assert b"walked    7" in shown and b"there is no action or command `zz`" in shown
