"""What the documentation shows works, and what it says of the code is what the code says.

Comments in the Markdown tell what a fenced block or a table is:

`<!-- file: NAME -->`      the block is a file that the examples of the document read
`<!-- run -->`             the `serp` commands of the block succeed
`<!-- run with: ... -->`   the same, with these options added
`<!-- accepted in: X -->`  the first column of the table is valid PDDL there
`<!-- refused in: X -->`   it is refused, with the message of the second column
`<!-- names of: X -->`     the first column lists exactly what the code has under X
`<!-- settings of: X -->`  name, meaning, range, `default`, `paper` of every setting of a section

Python blocks run in the order of their document and share their names. A `text` block right
after one of them, or after commands that are run, is what it prints.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import importlib.metadata
import io
import itertools
import math
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import click
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import serp
from serp.cli import main
from serp.cli.root import serp as group
from serp.compare.algorithms import OWN, algorithm_entries
from serp.control.arbiter import Actor, Reason
from serp.model.facts import InstantiationBudget
from serp.model.program import MAX_NATIVE_SIZE
from serp.runs.rows import DECISIONS_COLUMNS, METRICS_COLUMNS
from serp.settings import PRESETS, resolve
from serp.training.policies import Policy

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)
MARK = re.compile(r"<!-- (.+?) -->\n\Z")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block."""

    language: str
    text: str
    mark: str
    line: int
    follows: int
    """How many characters lie between it and the block before it."""


def blocks(document: Path) -> list[Block]:
    text = document.read_text(encoding="utf-8")
    found, end = [], 0
    for match in FENCE.finditer(text):
        mark = MARK.search(text[: match.start()])
        found.append(
            Block(
                language=match[1],
                text=match[2],
                mark=mark[1] if mark else "",
                line=text.count("\n", 0, match.start()) + 1,
                follows=match.start() - end,
            )
        )
        end = match.end()
    return found


def table_after(document: Path, mark: str) -> list[list[str]]:
    """The rows of the table under a mark, without its head; `\\|` is a bar inside a cell."""
    _, found, rest = document.read_text(encoding="utf-8").partition(f"<!-- {mark} -->\n")
    assert found, f"{document.name} has no table marked {mark}"
    lines = list(itertools.takewhile(lambda line: line.startswith("|"), rest.splitlines()))
    assert len(lines) > 2
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines[2:]]
    return [[cell.strip().replace("\\|", "|") for cell in row] for row in rows]


def code(cell: str) -> str:
    """What stands in the first pair of backquotes."""
    match = re.match(r"`([^`]+)`", cell)
    assert match, f"no code in {cell!r}"
    return match[1]


def by_name(path: Path) -> str:
    return path.name


def marks(kind: str) -> list[Any]:
    """Every mark of a kind, as (document, rest of the mark)."""
    return [
        pytest.param(document, found, id=f"{document.stem}-{found}")
        for document in DOCUMENTS
        for found in re.findall(rf"<!-- {kind}: (.+?) -->", document.read_text(encoding="utf-8"))
    ]


# Examples


def run_commands(block: Block) -> str:
    """Run the `serp` commands of a block as its mark says; returns what they print."""
    added = shlex.split(block.mark.partition("run with:")[2])
    commands = [line for line in block.text.splitlines() if line.startswith("serp ")]
    assert commands
    output = io.StringIO()
    for line in commands:
        arguments = shlex.split(line, comments=True)[1:] + added
        with pytest.raises(SystemExit) as end, contextlib.redirect_stdout(output):
            main(arguments)
        assert end.value.code == 0, line
    return output.getvalue()


def modules_of(requirements: Iterable[str]) -> set[str]:
    """What can be imported with some requirements, those of their extras included."""
    names = set()
    for text in requirements:
        asked = Requirement(text)
        names.add(asked.name)
        try:
            more = [Requirement(each) for each in importlib.metadata.requires(asked.name) or ()]
        except importlib.metadata.PackageNotFoundError:  # so nothing of it can be imported
            continue
        names |= {
            each.name for each in more for extra in asked.extras
            if each.marker and each.marker.evaluate({"extra": extra})
            and not each.marker.evaluate({"extra": ""})
        }  # fmt: skip
    known = importlib.metadata.packages_distributions()
    wanted = {canonicalize_name(name) for name in names}
    return {
        module
        for module, owners in known.items()
        if wanted & {canonicalize_name(owner) for owner in owners}
    }


def not_installed_by_the_readme() -> set[str]:
    """What the extras bring along that the README's first line that installs does not name."""
    line = next(b for b in blocks(ROOT / "README.md") if "pip install" in b.text)
    named = re.search(r"'?\.(?:\[([\w,]+)\])?'? &&", line.text)
    assert named, line.text
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    there = [*project["dependencies"], *(r for e in (named[1] or "").split(",") if e
                                         for r in extras[e])]  # fmt: skip
    absent = [r for name, requirements in extras.items() if name != "dev" for r in requirements]
    return modules_of(absent) - modules_of(there)


def test_extras_that_the_readme_does_not_install_are_found() -> None:
    assert "stable_baselines3" in not_installed_by_the_readme()


@pytest.mark.parametrize("document", DOCUMENTS, ids=by_name)
def test_examples_run(document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if document.name == "README.md":
        for module in not_installed_by_the_readme():
            monkeypatch.setitem(sys.modules, module, None)
    names: dict[str, Any] = {"__name__": "__main__"}
    printed: str | None = None
    for block in blocks(document):
        if block.mark.startswith("file: "):
            Path(block.mark.removeprefix("file: ")).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            output = io.StringIO()
            # Blank lines before it, so that a traceback names the line of the document.
            program = compile("\n" * block.line + block.text, str(document), "exec")
            with contextlib.redirect_stdout(output):
                exec(program, names)
            printed = output.getvalue()
            continue
        elif re.match(r"run( with:|$)", block.mark):
            printed = run_commands(block)
            continue
        elif block.language == "text" and printed is not None and block.follows <= 2:
            assert printed == block.text
        printed = None
    if document.name == "README.md":
        assert_made_by_the_commands(Path("runs/first/decisions.csv"))


def assert_made_by_the_commands(decisions: Path) -> None:
    """The decision that is shown is the first veto of the run; another machine may round apart."""
    shown = next(b for b in blocks(ROOT / "README.md") if b.language == "csv")
    (row,) = csv.DictReader(shown.text.splitlines())
    with decisions.open(newline="") as file:
        veto = next(each for each in csv.DictReader(file) if each["vetoed"] == "1")
    for column in {*row} - {"step", "episode", "executed", "predicted_reward", "rho"}:
        assert veto[column] == row[column]


def commands_shown(document: Path) -> list[list[str]]:
    """The words after `serp` of every command, in blocks and in the text."""
    text = document.read_text(encoding="utf-8")
    in_blocks = [
        line
        for block in blocks(document)
        if block.language == "sh"
        for line in block.text.splitlines()
        if line.startswith("serp ")
    ]
    in_text = re.findall(r"`(serp [^`]+)`", FENCE.sub("", text))
    return [shlex.split(line, comments=True)[1:] for line in [*in_blocks, *in_text]]


@pytest.mark.parametrize("document", DOCUMENTS, ids=by_name)
def test_commands_and_options_that_are_shown_exist(document: Path) -> None:
    root = click.Context(group)
    for words in commands_shown(document):
        command = group.get_command(root, words[0])
        assert command is not None, words
        known = {option for parameter in command.get_params(root) for option in parameter.opts}
        used = {word.split("=")[0] for word in words if word.startswith("--")}
        assert used <= known, words


def test_the_example_of_a_decision_log_has_its_columns_and_words() -> None:
    (example,) = (b for b in blocks(ROOT / "README.md") if b.language == "csv")
    header, *rows = csv.reader(example.text.splitlines())
    assert tuple(header) == DECISIONS_COLUMNS
    for row in rows:
        cells = dict(zip(header, row, strict=True))
        assert {cells["proposed_by"], cells["executed_by"]} <= {*Actor}
        assert cells["reason"] in {*Reason}
        quoted, line = re.findall(r"`(.+?)` \(line (\d+)\)", cells["explanation"])[0]
        domain = (ROOT / "domains" / "soccer.pddl").read_text(encoding="utf-8")
        assert quoted in domain.splitlines()[int(line) - 1]


def test_the_picture_is_what_the_program_draws(tmp_path: Path) -> None:
    """Its texts, that is: names, returns, legend. Coordinates may differ between versions."""
    file = tmp_path / "plan.svg"
    with pytest.raises(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        main(["plan", "--domain", str(ROOT / "domains" / "cartpole.pddl"), "--svg", str(file)])
    drawn, shown = (
        sorted(re.findall(r"<text[^>]*>(.+?)</text>", path.read_text(encoding="utf-8")))
        for path in (file, ROOT / "docs" / "images" / "plan.svg")
    )
    assert drawn
    assert shown == drawn


DOMAINS = [
    pytest.param(block, id=f"{document.stem}:{block.line}")
    for document in DOCUMENTS
    for block in blocks(document)
    if block.language == "pddl" and "(define (domain " in block.text
]


@pytest.mark.parametrize("block", DOMAINS)
def test_complete_domains_load(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "shown.pddl"
    file.write_text(block.text, encoding="utf-8")
    if "broken" in block.mark:
        with pytest.raises(serp.DomainError):
            serp.load_domain(file)
    else:
        serp.load_domain(file)


# The domain language


TEMPLATES = {
    "section": "",
    "declaration": "",
    "condition": "(:action do :parameters (?x - gate) :precondition (and {}) :effect (and))",
    "number": "(:action do :parameters (?x - gate) :effect (and (assign (level) {})))",
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
    file = folder / "fragment.pddl"
    file.write_text(f"(define (domain fragment) {' '.join(sections.values())})", encoding="utf-8")
    return serp.load_domain(file)


@pytest.mark.parametrize(("document", "where"), marks("accepted in"))
def test_what_is_said_to_be_accepted_is_accepted(
    document: Path, where: str, tmp_path: Path
) -> None:
    for row in table_after(document, f"accepted in: {where}"):
        domain = load_fragment(where, code(row[0]), tmp_path)
        assert where == "declaration" or domain.model.actions or domain.model.ground.processes


@pytest.mark.parametrize(("document", "where"), marks("refused in"))
def test_what_is_said_to_be_refused_is_refused_so(
    document: Path, where: str, tmp_path: Path
) -> None:
    for fragment, message, _ in table_after(document, f"refused in: {where}"):
        with pytest.raises(serp.DomainError) as error:
            load_fragment(where, code(fragment), tmp_path)
        assert message in str(error.value)


def test_the_limits_are_those_of_the_code() -> None:
    text = (ROOT / "docs" / "domain-language.md").read_text(encoding="utf-8")
    _, _, limits = text.partition("## Limits\n")
    most = InstantiationBudget()
    for number in (most.ground_schemas, most.fluents, most.bindings, MAX_NATIVE_SIZE):
        assert f"| {number:,} |" in limits


# Names


def run_files() -> set[str]:
    folder = Path("names")
    serp.plan_and_learn("cartpole", env_steps=30, out=folder, quiet=True)
    return {path.name for path in folder.iterdir()}


def comparison_files() -> set[str]:
    folder = Path("compared")
    serp.compare(
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
    "public names": lambda: {f"serp.{name}" for name in serp.__all__},
    "run folder": run_files,
    "algorithms": lambda: {*OWN, *algorithm_entries()},
    "comparison folder": comparison_files,
}
NOT_IN_EVERY_RUN = {"problem.pddl", "tensorboard/", "checkpoint-damaged.safetensors"}


@pytest.mark.parametrize(("document", "what"), marks("names of"))
def test_lists_of_names_are_complete(
    document: Path, what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    named = [name for row in table_after(document, f"names of: {what}") for name in
             re.findall(r"`([^`(]+)[^`]*`", row[0])]  # fmt: skip
    assert len(named) == len(set(named))
    expected = LISTS[what]()
    assert set(named) - expected <= NOT_IN_EVERY_RUN
    assert expected <= set(named)


def test_code_that_is_named_exists() -> None:
    """Every `serp.module.name` in the documents."""
    for document in DOCUMENTS:
        text = FENCE.sub("", document.read_text(encoding="utf-8"))
        for dotted in sorted(set(re.findall(r"`(serp(?:_\w+)?(?:\.\w+)+)(?:\([^`]*\))?`", text))):
            if dotted in ("serp.tasks", "serp.algorithms"):  # groups of entry points
                continue
            assert resolves(dotted), f"{document.name}: {dotted}"


def test_the_map_of_the_code_names_every_part() -> None:
    drawn = next(b.text for b in blocks(ROOT / "CONTRIBUTING.md") if not b.language)
    parts = {
        path.stem
        for path in (ROOT / "serp").iterdir()
        if path.is_dir() != (path.suffix == ".py") and not path.name.startswith("_")
    }
    assert {part for part in parts if not re.search(rf"\b{part}\b", drawn)} == set()


def resolves(dotted: str) -> bool:
    parts = dotted.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: Any = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part) and part not in getattr(found, "__annotations__", {}):
                return False
            found = getattr(found, part, None)
        return True
    return False


# Settings


def shown(value: Any) -> str:
    """A value as docs/settings.md writes it."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(map(str, value))}]"
    if isinstance(value, float) and value == int(value if math.isfinite(value) else 0):
        return f"{value:.1f}"
    return str(value)


RANGES: dict[str, tuple[tuple[Any, ...], tuple[Any, ...]]] = {
    # range as written → values inside, values outside
    "whole, ≥ 1": ((1, 7), (0, -1)),
    "whole, ≥ 0": ((0, 7), (-1,)),
    "≥ 0": ((0.0, 7.5), (-0.1,)),
    "> 0": ((0.1,), (0.0, -1.0)),
    "0 to 1": ((0.0, 1.0), (-0.1, 1.1)),
    "0 to below 1": ((0.0, 0.9), (-0.1, 1.0)),
    "above 0 to 1": ((0.1, 1.0), (0.0, 1.1)),
    "any number": ((-5.0, 0.0, 5.0), (float("nan"),)),
    "true, false": ((True, False), ()),
    "none": ((None,), ()),
    "list of whole, ≥ 1": (((8, 8), ()), ((0,),)),
    "`step`, `episode` or a name in `info`": (("step", "episode", "game"), ()),
}


def values_of(written: str) -> tuple[list[Any], list[Any]]:
    inside: list[Any] = []
    outside: list[Any] = []
    for part in written.split("; or "):
        if part in RANGES:
            inside += RANGES[part][0]
            outside += RANGES[part][1]
        else:
            names = re.findall(r"`(\w+)`", part)
            assert names, f"unknown range {part!r}"
            inside += names
            outside.append("nonsense")
    return inside, outside


@pytest.mark.parametrize(("document", "section"), marks("settings of"))
def test_settings_are_those_of_the_code(document: Path, section: str) -> None:
    rows = table_after(document, f"settings of: {section}")
    columns = {name: dataclasses.asdict(getattr(resolve(name), section)) for name in PRESETS}
    assert [code(row[0]) for row in rows] == list(columns["default"])
    for name, meaning, _, default, paper in rows:
        assert meaning
        assert default == f"`{shown(columns['default'][code(name)])}`", name
        assert paper == f"`{shown(columns['paper'][code(name)])}`", name


@pytest.mark.parametrize(("document", "section"), marks("settings of"))
def test_ranges_of_settings_are_those_of_the_code(document: Path, section: str) -> None:
    # A start from which one setting at a time can take any value of its range.
    free = {"target_period": None, "target_polyak": None, "failing_window": 1}
    start = resolve("default").replace({"arbiter": {"rho": 0.0}, "learner": free})
    for row in table_after(document, f"settings of: {section}"):
        name = code(row[0])
        inside, outside = values_of(row[2])
        for value in inside:
            start.replace({section: {name: value}})
        for value in outside:
            with pytest.raises(serp.SerpError):
                start.replace({section: {name: value}})


def test_every_section_and_preset_is_documented() -> None:
    sections = {field.name for field in dataclasses.fields(serp.Settings)}
    assert {param.values[1] for param in marks("settings of")} == sections
    assert set(PRESETS) == {"paper", "default"}


# Links


def anchors(document: Path) -> set[str]:
    text = FENCE.sub("", document.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", DOCUMENTS, ids=by_name)
def test_internal_links_lead_somewhere(document: Path) -> None:
    text = FENCE.sub("", document.read_text(encoding="utf-8"))
    for target in LINK.findall(text):
        if re.match(r"https?:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (document.parent / path).resolve() if path else document
        assert file.exists(), target
        assert file.is_relative_to(ROOT), target
        if anchor:
            assert anchor in anchors(file), target
