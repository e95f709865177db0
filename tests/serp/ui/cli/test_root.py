"""The command as a whole: its help, what it imports, and how it ends."""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner

import serp
from serp.ui.root import COMMANDS
from serp.ui.root import serp as group
from tests.serp.ui.cli.conftest import Run

HEAVY = {"gymnasium", "matplotlib", "networkx", "numba", "numpy", "rich", "torch"}


def subcommand(name: str) -> Any:
    command = group.get_command(click.Context(group), name)
    assert command is not None
    return command


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_examples_of_the_help_are_valid_command_lines(name: str, run: Run) -> None:
    shown = run(*filter(None, [name]), "--help").stdout
    assert name or all(f"{command} " in shown for command in COMMANDS)
    examples = re.findall(r"^    (serp .+)$", shown, re.M)
    assert examples
    for example in examples:
        words = shlex.split(example.partition(">")[0])
        assert not name or words[1] == name
        if words[-1] != "--help":
            with group.make_context("serp", words[1:]) as ctx:
                command = subcommand(words[1])
                command.make_context(words[1], words[2:], parent=ctx).close()


def test_the_package_runs_and_help_imports_nothing_heavy(tmp_path: Path) -> None:
    script = (
        "import json, sys; from serp.ui.root import COMMANDS, serp\n"
        "for name in COMMANDS: serp([name, '--help'], standalone_mode=False)\n"
        "print(); print(json.dumps(list(sys.modules)))"
    )
    options: dict[str, Any] = {"cwd": tmp_path, "capture_output": True, "check": True}
    done = subprocess.run([sys.executable, "-c", script], text=True, **options)
    assert HEAVY.isdisjoint(json.loads(done.stdout.splitlines()[-1]))
    done = subprocess.run([sys.executable, "-m", "serp", "--version"], text=True, **options)
    assert done.stdout == f"serp {serp.__version__}\n"


def test_an_unknown_command_or_option_says_what_there_is(run: Run) -> None:
    assert "did you mean `evaluate`?" in run("evalute", expect=2).stderr
    assert "No such option" in run("--nonsense", expect=2).stderr


def test_a_mistake_keeps_its_traceback_when_debugging(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SERP_DEBUG", "1")
    result = CliRunner().invoke(group, ["plan", "--domain", "nosuch.pddl"])
    assert isinstance(result.exception, serp.SerpError)


@pytest.mark.skipif(os.name == "nt", reason="pipes there have no EPIPE")
def test_a_reader_that_went_away_is_no_error(walk: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "serp", "check", "walk.pddl"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def test_what_the_terminal_cannot_show_is_replaced(walk: Path) -> None:
    walk.rename("wälk.pddl")
    command = [sys.executable, "-m", "serp", "check", "wälk.pddl"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run(command, capture_output=True, env=environment, check=True)
    assert b"w?lk.pddl: " in done.stdout
