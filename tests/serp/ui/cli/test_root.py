"""The command as a whole: its help, what it imports, how it ends, settings, and `serp list`."""

import errno
import json
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import EntryPoint

import click
import pytest
from click.testing import CliRunner

import serp
from serp.errors import RunError
from serp.runs.comparison.algorithms import OWN, algorithm_entries
from serp.settings import PRESETS, resolve
from serp.tasks.registry import GROUP, load_task, task_entries
from serp.ui.options import parse_settings
from serp.ui.output import print_json
from serp.ui.root import COMMANDS, exit_with
from serp.ui.root import serp as group

NEVER = {
    "matplotlib", "networkx", "onnx", "scipy", "stable_baselines3", "torch", "unified_planning",
}  # fmt: skip
"""What no command imports that looks at something and draws and learns nothing."""
TASKS = NEVER | {"gymnasium", "pydantic"}
"""Nor a command that looks at a file which belongs to no task."""
HEAVY = TASKS | {"numpy", "rich"}
"""Nor the help."""


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_examples_of_the_help_are_valid_command_lines(name, run):
    shown = run(*filter(None, [name]), "--help").stdout
    assert name or all(f"{command} " in shown for command in COMMANDS)
    examples = re.findall(r"^    (serp .+)$", shown, re.M)
    assert examples
    for example in examples:
        words = shlex.split(example.partition(">")[0])
        assert not name or words[1] == name
        if words[-1] != "--help":
            with group.make_context("serp", words[1:]) as ctx:
                command = group.get_command(ctx, words[1])
                command.make_context(words[1], words[2:], parent=ctx).close()


def test_the_package_runs_and_help_imports_nothing_heavy(tmp_path):
    assert HEAVY.isdisjoint(loaded_by(*(f"{name} --help" for name in COMMANDS)))
    options = {"cwd": tmp_path, "capture_output": True, "check": True}
    done = subprocess.run([sys.executable, "-m", "serp", "--version"], text=True, **options)
    assert done.stdout == f"serp {serp.__version__}\n"


def loaded_by(*lines):
    """Names of the modules that commands import, one after another in a new process."""
    script = (
        "import json, shlex, sys; from serp.ui.root import serp\n"
        "for line in sys.argv[1:]: serp(shlex.split(line), standalone_mode=False)\n"
        "print(); print(json.dumps(list(sys.modules)))"
    )
    command = [sys.executable, "-c", script, *lines]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return {*json.loads(done.stdout.splitlines()[-1])}


def test_a_file_without_a_task_is_checked_without_what_tasks_need(walk):
    loaded = loaded_by(f"check {walk}")
    assert "serp.model.domain" in loaded
    assert TASKS.isdisjoint(loaded)


def test_looking_at_tasks_and_runs_imports_no_library_for_learning_or_drawing(trained):
    loaded = loaded_by("list", "check cartpole", "plan --domain cartpole", f"why {trained}")
    assert {"gymnasium", "serp.runs.run"} <= loaded
    assert NEVER.isdisjoint(loaded)


def test_an_unknown_command_or_option_says_what_there_is(run):
    assert "did you mean `evaluate`?" in run("evalute", expect=2).stderr
    assert "No such option" in run("--nonsense", expect=2).stderr


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("compare", "give --domain"),
        ("plan-and-learn", "give --domain"),
        ("plan-and-learn --resume=a --out=b", "--out cannot change"),
        ("plan-and-learn --resume=a --seed=1", "--seed cannot change"),
        ("plan-and-learn --domain=cartpole --num-envs=2 --set=training.num_envs=3",
         "--set training.num_envs is given twice"),
        ("plan --domain=cartpole --svg=walk.pddl", "ends in .svg"),
        ("why a --episode=1", "--episode needs --step"),
    ],
)  # fmt: skip
def test_a_wrong_command_line_is_refused_before_anything_is_written(line, message, run, folder):
    assert message in run(*line.split(), expect=2).stderr
    assert list(folder.iterdir()) == []


def test_a_mistake_keeps_its_traceback_when_debugging(folder, monkeypatch):
    monkeypatch.setenv("SERP_DEBUG", "1")
    result = CliRunner().invoke(group, ["plan", "--domain", "nosuch.pddl"])
    assert isinstance(result.exception, serp.SerpError)


@pytest.mark.skipif(os.name == "nt", reason="pipes there have no EPIPE")
def test_a_reader_that_went_away_is_no_error(walk):
    read, write = os.pipe()
    os.close(read)
    command = [sys.executable, "-m", "serp", "check", "walk.pddl"]
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


def raising(error):
    def run():
        raise error

    return run


def noted(error, note):
    error.add_note(note)
    return error


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (noted(RunError("no such run"), "Continue with"), 1, "Error: no such run\nContinue with\n"),
        (FileNotFoundError(2, "No such file", "x.svg"), 1, "Error: x.svg: No such file\n"),
        (OSError(errno.ENOSPC, "No space left"), 1,
         "Error: No space left (free some space, then try again)\n"),
        (click.UsageError("what?"), 2, "Error: what?\n"),
        (KeyboardInterrupt(), 130, "Stopped.\n"),
        (BrokenPipeError(errno.EPIPE, "Broken pipe"), 141, ""),
    ],
)  # fmt: skip
def test_what_the_user_can_mend_is_a_message(error, status, message, capfd):
    with pytest.raises(SystemExit) as end:
        exit_with(raising(error))
    assert end.value.code == status
    assert capfd.readouterr() == ("", message)


def test_a_bug_keeps_its_traceback():
    with pytest.raises(ZeroDivisionError):
        exit_with(raising(ZeroDivisionError()))


def test_every_setting_can_be_set_to_what_it_is():
    settings = resolve("paper")
    texts = [
        f"{section}.{name}={value if value == 'inf' else json.dumps(value)}"
        for section, values in settings.as_dict().items()
        for name, value in values.items()
    ]
    assert resolve("default", None, parse_settings(texts)) == settings
    given = parse_settings(["planner.name=none", "learner.hidden=[64", "arbiter.r_min=-1e-3"])
    assert given == {
        "planner": {"name": None}, "learner": {"hidden": "[64"}, "arbiter": {"r_min": -0.001},
    }  # fmt: skip


def test_json_has_no_infinity(capsys):
    print_json({"a": float("inf"), "b": [float("nan"), 1.5], "ρ": "ρ"})

    def refuse(constant):
        raise AssertionError(constant)

    read = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert read == {"a": None, "b": [None, 1.5], "ρ": "ρ"}


def test_everything_installed_is_listed(run):
    shown = run("list").stdout
    for name in task_entries():
        assert f"\n{name} " in shown
        assert load_task(name).description in shown
    for name in (*PRESETS, *OWN, *algorithm_entries(), "evidence", "mixture", "lookahead", "dqn"):
        assert f"\n{name} " in shown
    table = re.sub(" +", " ", shown.partition("\nplanner.name (--planner)")[2])
    assert "\nfar-sight the planner that sees to the end of a finite task" in table


def test_a_task_that_cannot_be_loaded_hides_no_other(run, monkeypatch):
    broken = EntryPoint("broken", "no_such_package:task", GROUP)
    entries = {**task_entries(), "broken": broken}
    monkeypatch.setattr("serp.tasks.registry.task_entries", lambda: entries)
    shown = run("list").stdout
    assert "No module named 'no_such_package'" in shown
    assert "\ncartpole " in shown
