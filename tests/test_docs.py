"""What the documentation shows works, and what it says of the code is what the code says.

The site is built by `.ci/run` with warnings as errors, which checks its links and references.

Comments in the Markdown tell what a fenced block or a table is:

`<!-- file: NAME -->`      the block is a file that the examples of the page read
`<!-- from: FILE -->`      the block is a part of that file of the repository
`<!-- run -->`             the `serp` commands of the block succeed
`<!-- run with: ... -->`   the same, with these options added
`<!-- as in: PAGE -->`     the `serp` commands of the block are among those that are run on a page
`<!-- accepted in: X -->`  the first column of the table is valid PDDL there
`<!-- refused in: X -->`   it is refused, with the message of the second column
`<!-- one step: X -->`     the table tells what `docs/examples/tea.pddl` does with it in one step
`<!-- messages -->`        the first column quotes messages of the code, `…` for what varies
`<!-- scenarios: X -->`    the first column of the table is a statement of a scenario file
`<!-- names of: X -->`     the first column lists exactly what the code has under X
`<!-- row of: X -->`       the table has the columns of that file, and a value for each

Python blocks run in the order of their page and share their names. A `text` block right after
one of them, or after commands that are run, is what it prints.
"""

from __future__ import annotations

import ast
import contextlib
import csv
import importlib.util
import io
import itertools
import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args
from urllib.request import urlopen

import click
import numpy as np
import pytest

import serp
from serp.cli import main
from serp.cli.root import serp as group
from serp.comparison.algorithms import OWN, algorithm_entries
from serp.comparison.compare import compare
from serp.control.decision import Actor, Reason
from serp.model.facts import InstantiationBudget
from serp.model.program import MAX_NATIVE_SIZE
from serp.pddl.source import Source
from serp.runs.recording_format import COLUMNS
from serp.runs.rows import DECISIONS_COLUMNS, METRICS_COLUMNS
from serp.scenarios.reading import read_scenarios
from serp.tasks.registry import task_entries
from serp.training.policies import Policy
from tests.serp.studio.browser import served
from tests.serp.training.runs import without_pictures

ROOT = Path(__file__).resolve().parent.parent
EXAMPLES = ROOT / "docs" / "examples"
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
PUBLIC = ("serp", "serp_envs", "serp_adapters.stable_baselines3")
"""Packages that examples import from."""
FENCE = re.compile(r"^```([\w{}-]*)[^\n]*\n(.*?)^```$", re.M | re.S)
MARK = re.compile(r"<!-- (.+?) -->\n\Z")


@dataclass(frozen=True)
class Block:
    """A fenced block; `follows` is the number of characters between it and the block before it."""

    language: str
    text: str
    mark: str
    line: int
    follows: int


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found, end = [], 0
    for match in FENCE.finditer(text):
        mark = MARK.search(text[: match.start()])
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(match[1], match[2], mark[1] if mark else "", line, match.start() - end))
        end = match.end()
    return found


def prose(page: Path) -> str:
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def table_after(page: Path, mark: str) -> list[list[str]]:
    """The rows of the table under a mark, without its head; `\\|` is a bar inside a cell."""
    rest = page.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n")[2]
    lines = list(itertools.takewhile(lambda line: line.startswith("|"), rest.splitlines()))
    assert len(lines) > 2
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines[2:]]
    return [[cell.strip().replace("\\|", "|") for cell in row] for row in rows]


def code(cell: str) -> str:
    """What stands in the first pair of backquotes."""
    match = re.match(r"`([^`]+)`", cell)
    assert match, f"no code in {cell!r}"
    return match[1]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def marks(kind: str) -> list[Any]:
    """Every mark of a kind, as (page, rest of the mark)."""
    return [
        pytest.param(page, found, id=f"{page.stem}-{found}")
        for page in PAGES
        for found in re.findall(rf"<!-- {kind}: (.+?) -->", page.read_text(encoding="utf-8"))
    ]


# Examples


def is_run(block: Block) -> bool:
    return re.match(r"run( with:|$)", block.mark) is not None


def commands(*found: Block) -> list[list[str]]:
    """The words of the `serp` commands of blocks."""
    lines = [line for block in found for line in block.text.splitlines()]
    return [shlex.split(line, comments=True) for line in lines if line.startswith("serp ")]


def run_commands(block: Block) -> str:
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
            main(words[1:] + added)
        assert end.value.code == 0, words
    return output.getvalue()


def pictures(name: str) -> contextlib.AbstractContextManager[None]:
    """Pictures of runs are drawn for two pages: they take longer than the other trainings here."""
    drawn = name in ("first-run", "diagnose")
    return contextlib.nullcontext() if drawn else without_pictures()


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=name_of)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(EXAMPLES, tmp_path, dirs_exist_ok=True)
    with pictures(page.stem):
        run_blocks(page)


def run_blocks(page: Path) -> None:
    names: dict[str, Any] = {"__name__": "__main__"}
    printed: str | None = None
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


@pytest.mark.parametrize("script", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_example_scripts_run(
    script: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pictures(script.stem):
        runpy.run_path(str(script), run_name="__main__")
    printed = capsys.readouterr().out
    shown = re.findall(r"^# prints:\n((?:# .*\n)+)", script.read_text(encoding="utf-8"), re.M)
    assert printed if not shown else printed == re.sub(r"^# ", "", shown[0], flags=re.M)


@pytest.mark.parametrize(
    ("library", "script"),
    [
        ("highway_env", "highway/highway.py"),
        ("mlflow", "logging/mlflow_run.py"),
        ("wandb", "logging/wandb_run.py"),
    ],
)
def test_examples_of_other_libraries_run_where_these_are(
    library: str, script: str, tmp_path: Path
) -> None:
    for file in (EXAMPLES / script).parent.glob("*.pddl"):
        serp.load_domain(file)
    if importlib.util.find_spec(library) is None:
        pytest.skip(f"{library} is not installed")
    subprocess.run(
        [sys.executable, EXAMPLES / script],
        cwd=tmp_path, env={**os.environ, "WANDB_MODE": "offline"}, check=True, timeout=300,
    )  # fmt: skip


def test_the_parts_of_the_hierarchical_task_fit_together() -> None:
    defence = runpy.run_path(str(EXAMPLES / "defence" / "defence.py"))
    options = dict.fromkeys(("approach", "contest"))
    for task in (defence["approach"](), defence["contest"](None), defence["defence"](options)):
        with task.bind() as bound:
            bound.reset(seed=0)


def test_an_extension_is_found_by_its_entry_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    source = shutil.copytree(EXAMPLES / "extension", tmp_path / "source")
    where = ["--no-build-isolation", "--target", str(tmp_path / "site"), str(source)]
    subprocess.run([*pip, *where], check=True, timeout=120)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "site")
    monkeypatch.setitem(sys.modules, "my_extension", None)  # so that it is absent in the end
    del sys.modules["my_extension"]
    names = ["guide.strategy=planner-first", "learner.learning_starts=40", "planner.name=one-step"]
    words = ["plan-and-learn", "--domain=cartpole", "--env-steps=80", "--out=run", "--quiet"]
    with pytest.raises(SystemExit) as end, without_pictures():
        main([*words, *(f"--set={name}" for name in [*names, "learner.name=table"])])
    assert end.value.code == 0
    with (tmp_path / "run" / "decisions.csv").open(newline="", encoding="utf-8") as file:
        proposed = [row["proposed_by"] for row in csv.DictReader(file)]
    assert set(proposed[:40]) == {"planner"}
    assert set(proposed[41:]) <= {"learner", "exploration"}


def test_the_learner_of_the_extension_learns_and_continues_exactly() -> None:
    spec = importlib.util.spec_from_file_location("e", EXAMPLES / "extension" / "my_extension.py")
    assert spec is not None and spec.loader is not None
    extension = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(extension)

    def walked(learner: Any, steps: int) -> list[int]:
        """Walk along five cells, with a reward at the right end."""
        at, chosen = 0, []
        for _ in range(steps):
            action = learner.propose(np.array([at]), None).action
            to = max(0, at + (1 if action else -1))
            learner.remember(np.array([at]), action, float(to == 4), np.array([to]), to == 4, False)
            at = 0 if to == 4 else to
            chosen.append(action)
        return chosen

    settings = serp.LearnerSettings(epsilon_end=0.2, epsilon_steps=200)
    learner = extension.Table(1, 2, settings, 0)
    walked(learner, 400)
    again = extension.Table(1, 2, settings, 9)
    again.load_state_dict(*learner.state_dict())
    assert walked(again, 50) == walked(learner, 50)
    assert [learner.propose_greedily(np.array([at])).action for at in range(4)] == [1] * 4


def test_examples_import_only_public_names() -> None:
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
def test_commands_and_options_that_are_shown_exist(page: Path) -> None:
    root = click.Context(group)
    lines = [
        line
        for block in blocks(page)
        if block.language == "sh"
        for line in block.text.splitlines()
        if line.startswith("serp ")
    ]
    for line in [*lines, *re.findall(r"`(serp [^`…]+)`", prose(page))]:
        words = shlex.split(line, comments=True)[1:]
        command = group.get_command(root, words[0])
        assert command is not None, words
        known = {option for parameter in command.get_params(root) for option in parameter.opts}
        assert {word.split("=")[0] for word in words if word.startswith("--")} <= known, words


def test_the_example_of_a_decision_log_has_its_columns_and_words() -> None:
    page = ROOT / "docs" / "how-to" / "read-a-run.md"
    row = {code(name): value for name, value in table_after(page, "row of: decisions.csv")}
    assert tuple(row) == DECISIONS_COLUMNS
    assert {row["proposed_by"], row["executed_by"]} <= {*Actor}
    assert row["reason"] in {*Reason}
    quoted, line = re.findall(r"`(.+?)` \(line (\d+)\)", row["explanation"])[0]
    domain = (ROOT / "domains" / "soccer.pddl").read_text(encoding="utf-8")
    assert quoted in domain.splitlines()[int(line) - 1]


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(block, id=f"{page.stem}:{block.line}")
        for page in PAGES
        for block in blocks(page)
        if block.language == "pddl" and "(define (domain " in block.text
    ],
)
def test_complete_domains_load(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "shown.pddl"
    file.write_text(block.text, encoding="utf-8")
    with pytest.raises(serp.DomainError) if "broken" in block.mark else contextlib.nullcontext():
        serp.load_domain(file)


# The domain language


TEMPLATES = {
    "condition": "(:action do :parameters (?x - gate) :precondition (and {}) :effect (and))",
    **dict.fromkeys(
        ("number", "function"),
        "(:action do :parameters (?x - gate) :effect (and (assign (level) {})))",
    ),
    "effect": "(:action do :parameters (?x - gate) :effect (and {}))",
    "process": "(:process do :parameters (?x - gate) :effect (and {}))",
}
SURROUNDINGS = {
    ":types": "(:types gate side thing)",
    ":constants": "(:constants door - gate)",
    ":predicates": "(:predicates (open ?d - gate) (unsafe))",
    ":functions": "(:functions (level) (weight ?d - gate) (reward))",
}


def load_fragment(where: str, fragment: str, folder: Path) -> serp.Domain:
    """Load a domain around a fragment."""
    sections = dict(SURROUNDINGS)
    if where in ("section", "declaration"):
        sections[fragment.split()[0].strip("(")] = fragment
        if fragment.startswith("(:types"):
            del sections[":constants"], sections[":predicates"], sections[":functions"]
    else:
        sections["schema"] = TEMPLATES[where].format(fragment)
        sections[":requirements"] = "(:requirements :math-functions)" if where == "function" else ""
    file = folder / "fragment.pddl"
    file.write_text(f"(define (domain fragment) {' '.join(sections.values())})", encoding="utf-8")
    return serp.load_domain(file)


@pytest.mark.parametrize(("page", "where"), marks("accepted in"))
def test_what_is_said_to_be_accepted_is_accepted(page: Path, where: str, tmp_path: Path) -> None:
    for row in table_after(page, f"accepted in: {where}"):
        domain = load_fragment(where, code(row[0]), tmp_path)
        assert where == "declaration" or domain.model.actions or domain.model.ground.processes


@pytest.mark.parametrize(("page", "where"), marks("refused in"))
def test_what_is_said_to_be_refused_is_refused_so(page: Path, where: str, tmp_path: Path) -> None:
    for fragment, message, _ in table_after(page, f"refused in: {where}"):
        with pytest.raises(serp.DomainError) as error:
            load_fragment(where, code(fragment), tmp_path)
        assert message in str(error.value)


STEPS = {
    "condition": "(:action try :parameters () :precondition (and {}) :effect (and))",
    "effect": "(:action try :parameters () :precondition (and) :effect (and {}))",
    **dict.fromkeys(
        ("process", "event", "flag"),
        "{} (:action try :parameters () :precondition (and) :effect (and))",
    ),
}


@pytest.mark.parametrize(("page", "kind"), marks("one step"))
def test_the_guides_tell_what_happens_in_one_step(page: Path, kind: str, tmp_path: Path) -> None:
    tea = (EXAMPLES / "tea.pddl").read_text(encoding="utf-8").partition("  (:action")[0]
    problem = (EXAMPLES / "tea-problem.pddl").read_text(encoding="utf-8")
    # Fluents may have any value, and the rows name cups, which belong to the domain then.
    moved = re.compile(r"\(= \((temperature|water)\) .+\)\n|\(:objects .+\)\n")
    (tmp_path / "tea-problem.pddl").write_text(moved.sub("", problem), encoding="utf-8")
    tea += "(:constants red blue - cup)"
    file = tmp_path / "tea.pddl"
    for fragment, before, after, _ in table_after(page, f"one step: {kind}"):
        file.write_text(f"{tea} {STEPS[kind].format(code(fragment))})", encoding="utf-8")
        if "error: " in after:
            with pytest.raises(serp.DomainError) as error:
                serp.load_domain(file)
            assert code(after.partition("error: ")[2]) in str(error.value)
            continue
        model = serp.load_domain(file, observed=True).model.replace(dt=1.0)
        names = [fluent.name for fluent in model.fluents]
        values = dict.fromkeys(names, 0.0) | told(before)
        step = model.step([values[name] for name in names], "try")
        assert step.applicable == (after != "not applicable"), fragment
        assert step.unsafe == ("unsafe" in after.split(", ")), fragment
        assert step.terminal == ("the task ends" in after), fragment
        assert step.reward == pytest.approx(told(after).get("reward", 0.0)), fragment
        expected = values | told(after)
        assert list(step.state) == pytest.approx([expected[name] for name in names]), fragment


def told(cell: str) -> dict[str, float]:
    """The values of a cell such as "`temperature = 20`, `filled red`, `not heater-on`"."""
    found = {}
    for part in re.findall(r"`([^`]+)`", cell):
        name, _, number = part.partition(" = ")
        found[name.removeprefix("not ")] = float(number or not name.startswith("not "))
    return found


@pytest.mark.parametrize(("page", "kind"), marks("scenarios"))
def test_statements_of_scenarios_are_read(page: Path, kind: str) -> None:
    domain = serp.load_domain(ROOT / "domains" / "lunar-lander.pddl", observed=True)
    lines = [code(row[0]) for row in table_after(page, f"scenarios: {kind}")]
    text = "".join(
        f"scenario {number}\n{line}\nallows fall\n"
        if kind == "situation"
        else f"scenario {number}\n{line}\n"
        for number, line in enumerate(lines)
    )
    source = Source("page.scenarios", f"scenario a lean\n(lean) = 1\nallows fall\n{text}")
    assert len(read_scenarios(source, domain, domain.model)) == len(lines) + 1


def texts_of(node: ast.expr) -> str:
    """A text in the code, with `…` for what is filled in."""
    if isinstance(node, ast.JoinedStr):
        return "".join(texts_of(value) for value in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else "…"


def test_messages_that_are_explained_are_those_of_the_code() -> None:
    page = (ROOT / "docs" / "how-to" / "troubleshooting.md").read_text(encoding="utf-8")
    quoted = re.findall(r"^\| `+ ?(.+?) ?`+ (?:\(.+\) )?\|", page, re.M)
    assert len(quoted) == len(re.findall(r"^\| .*`.*\|$", page, re.M)) > 40
    said = "\n".join(
        {
            texts_of(node)
            for file in (ROOT / "serp").rglob("*.py")
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            if isinstance(node, ast.JoinedStr | ast.Constant)
        }
    )
    for message in quoted:
        parts = [re.escape(part) for part in re.split(r"`?…`?", message) if part]
        assert re.search(".*".join(parts), said), message


def test_the_limits_are_those_of_the_code() -> None:
    text = (ROOT / "docs" / "reference" / "domain-language.md").read_text(encoding="utf-8")
    limits = text.partition("## Limits\n")[2]
    most = InstantiationBudget()
    for number in (most.ground_schemas, most.fluents, most.bindings, MAX_NATIVE_SIZE):
        assert f"| {number:,} |" in limits


# Names


def run_files() -> set[str]:
    folder = Path("names")
    serp.plan_and_learn("cartpole", env_steps=30, out=folder, quiet=True)
    return {path.name + "/" * path.is_dir() for path in folder.iterdir()}


def comparison_files() -> set[str]:
    folder = Path("compared")
    compare(
        "cartpole", algorithms=["mrp"], seeds=1, env_steps=30, final_episodes=1, out=folder,
        jobs=1, quiet=True,
    )  # fmt: skip
    return {path.name + "/" * path.is_dir() for path in folder.iterdir()}


LISTS: dict[str, Callable[[], set[str]]] = {
    "metrics.csv": lambda: set(METRICS_COLUMNS),
    "decisions.csv": lambda: set(DECISIONS_COLUMNS),
    "actors": lambda: {actor.value for actor in Actor},
    "reasons": lambda: {reason.value for reason in Reason},
    "policies": lambda: set(get_args(Policy)),
    "run folder": run_files,
    "recording": lambda: set(COLUMNS),
    "algorithms": lambda: {*OWN, *algorithm_entries()},
    "tasks": lambda: set(task_entries()),
    "comparison folder": comparison_files,
}
NOT_IN_EVERY_RUN = {
    "problem.pddl",
    "planner-1.pddl",
    "planner-1-problem.pddl",
    "evaluations/",
    "report.html",
    "tensorboard/",
    "checkpoint-damaged.safetensors",
}


@pytest.mark.parametrize(("page", "what"), marks("names of"))
def test_lists_of_names_are_complete(
    page: Path, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    named = [name for row in table_after(page, f"names of: {what}") for name in
             re.findall(r"`([^`(]+)[^`]*`", row[0])]  # fmt: skip
    assert len(named) == len(set(named))
    expected = LISTS[what]()
    assert set(named) - expected <= NOT_IN_EVERY_RUN
    assert expected <= set(named)


def test_the_reference_has_every_public_name() -> None:
    text = (ROOT / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
    named = re.findall(r"^\.\. auto\w+:: serp\.(\w+)$", text, re.M)
    assert sorted(named) == sorted({*serp.__all__} - {"__version__"})


def test_every_public_name_is_documented() -> None:
    for name in {*serp.__all__} - {"__version__"}:
        text = getattr(serp, name).__doc__
        assert text, name
        for dotted in re.findall(r"`(serp(?:\.\w+)+)`", text):
            assert dotted in ENTRY_POINTS or dotted.split(".")[1] in serp.__all__, (name, dotted)


def test_code_that_is_named_exists() -> None:
    """Every `serp.module.name` in the pages."""
    for page in PAGES:
        if page.name == "CHANGELOG.md":
            continue
        for dotted in sorted(
            set(re.findall(r"`(serp(?:_\w+)?(?:\.\w+)+)(?:\([^`]*\))?`", prose(page)))
        ):
            assert dotted in ENTRY_POINTS or resolves(dotted), f"{page.name}: {dotted}"


ENTRY_POINTS = {
    f"serp.{name}"
    for name in ("tasks", "algorithms", "engines", "planners", "learners", "strategies")
}


def resolves(dotted: str) -> bool:
    module, _, name = dotted.rpartition(".")
    for path in (dotted, module):
        with contextlib.suppress(ModuleNotFoundError):
            found = importlib.import_module(path)
            return path == dotted or hasattr(found, name)
    owner, _, attribute = module.rpartition(".")
    return hasattr(getattr(importlib.import_module(owner), attribute), name)


# Links of the pages that are no part of the site


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.+)$", prose(page), re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", sorted(ROOT.glob("*.md")), ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"!?\[[^\]]*\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"https?:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), target
        assert file.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(file), target
