"""Blocks of the pages: commands succeed, Python runs and prints what is shown, domains load."""

import ast
import contextlib
import csv
import importlib
import io
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.request import urlopen

import click
import pytest

import serp
from serp.ui.root import serp as group
from tests.docs.pages import EXAMPLES, PAGES, ROOT, blocks, name_of, prose
from tests.serp.ui.studio.browser import served

PUBLIC = ("serp", "serp_envs", "serp_adapters.stable_baselines3")
"""Packages that examples import from."""


def is_run(block):
    return re.match(r"run( with:|$)", block.mark) is not None


def commands(*found):
    """The words of the `serp` commands of blocks."""
    lines = [line for block in found for line in block.text.replace("\\\n", "").splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("serp ")]


def run_commands(block):
    """Run the `serp` commands of a block as its mark says; returns what they print."""
    added = shlex.split(block.mark.partition("run with:")[2])
    assert commands(block)
    output = io.StringIO()
    for words in commands(block):
        if words[1] == "studio":  # it serves until it is ended
            with served(words[2], Path.cwd()) as address, urlopen(address, timeout=60) as page:
                assert page.status == 200
            continue
        with pytest.raises(SystemExit) as end, contextlib.redirect_stdout(output):
            group(words[1:] + added, prog_name="serp")
        assert end.value.code == 0, words
    return output.getvalue()


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=name_of)
def test_examples_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(EXAMPLES, tmp_path, dirs_exist_ok=True)
    names = {"__name__": "__main__"}
    printed = None
    for block in blocks(page):
        kind, _, argument = block.mark.partition(": ")
        if kind == "from":
            assert block.text.strip() in (ROOT / argument).read_text(encoding="utf-8")
            continue
        if kind == "as in":
            there = commands(*filter(is_run, blocks(ROOT / argument)))
            assert all(words in there for words in commands(block))
        elif kind == "file":
            Path(argument).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            output = io.StringIO()
            # Blank lines before it, so that a traceback names the line of the page.
            program = compile("\n" * block.line + block.text, str(page), "exec")
            with contextlib.redirect_stdout(output):
                exec(program, names)
            printed = output.getvalue()
            continue
        elif is_run(block):
            printed = run_commands(block)
            continue
        elif block.language == "text" and printed is not None and block.follows <= 2:
            assert printed == block.text
        printed = None


def test_examples_import_only_public_names():
    programs = [
        (script.name, script.read_text(encoding="utf-8")) for script in EXAMPLES.rglob("*.py")
    ]
    programs += [(name_of(p), b.text) for p in PAGES for b in blocks(p) if b.language == "python"]
    assert len(programs) > 5
    for name, text in programs:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                assert not any(each.name.startswith("serp.") for each in node.names), name
            elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("serp"):
                assert node.module in PUBLIC, name
                public = importlib.import_module(node.module).__all__
                assert {each.name for each in node.names} <= set(public), name


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_that_are_shown_exist(page):
    root = click.Context(group)
    shown = commands(*(block for block in blocks(page) if block.language == "sh"))
    named = re.findall(r"`(serp [^`…]+)`", prose(page))
    for words in [*shown, *(shlex.split(line, comments=True) for line in named)]:
        words = words[1:]
        command = group.get_command(root, words[0])
        assert command is not None, words
        known = {option for parameter in command.get_params(root) for option in parameter.opts}
        assert {word.split("=")[0] for word in words if word.startswith("--")} <= known, words


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(block, id=f"{page.stem}:{block.line}")
        for page in PAGES
        for block in blocks(page)
        if block.language == "pddl" and "(define (domain " in block.text
    ],
)
def test_complete_domains_load(block, tmp_path):
    file = tmp_path / "shown.pddl"
    file.write_text(block.text, encoding="utf-8")
    with pytest.raises(serp.DomainError) if "broken" in block.mark else contextlib.nullcontext():
        serp.load_domain(file)


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_scripts_run(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    shown = re.findall(r"^# prints:\n((?:# .*\n)+)", script.read_text(encoding="utf-8"), re.M)
    assert printed if not shown else printed == re.sub(r"^# ", "", shown[0], flags=re.M)


def test_the_domain_file_of_a_library_that_is_not_installed_loads():
    serp.load_domain(EXAMPLES / "highway" / "highway.pddl")


def test_the_parts_of_the_hierarchical_task_fit_together():
    defence = runpy.run_path(str(EXAMPLES / "defence" / "defence.py"))
    options = dict.fromkeys(("approach", "contest"))
    for task in (defence["approach"](), defence["contest"](None), defence["defence"](options)):
        with task.bind() as bound:
            bound.reset(seed=0)


def test_an_extension_is_found_by_its_entry_points(tmp_path, monkeypatch):
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    source = shutil.copytree(EXAMPLES / "extension", tmp_path / "source")
    where = ["--no-build-isolation", "--target", str(tmp_path / "site"), str(source)]
    subprocess.run([*pip, *where], check=True, timeout=120)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setitem(sys.modules, "my_extension", None)  # so that it is absent in the end
    del sys.modules["my_extension"]
    names = ["guide.strategy=planner-first", "learner.learning_starts=40", "planner.name=one-step"]
    words = ["plan-and-learn", "--domain=cartpole", "--episodes=2", "--out=run", "--quiet"]
    with pytest.raises(SystemExit) as end:
        group(
            [*words, *(f"--set={name}" for name in [*names, "learner.name=table"])],
            prog_name="serp",
        )
    assert end.value.code == 0
    with (tmp_path / "run" / "decisions.csv").open(newline="", encoding="utf-8") as file:
        proposed = [row["proposed_by"] for row in csv.DictReader(file)]
    assert set(proposed[:40]) == {"planner"}
    assert proposed[40:] and set(proposed[40:]) <= {"learner", "exploration"}
