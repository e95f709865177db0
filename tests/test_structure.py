"""The shape of the code: imports go one way, files are small, names are unique."""

import ast
import re
from functools import cache
from pathlib import Path

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {
    "serp": ROOT / "serp",
    "serp_adapters": ROOT / "adapters" / "serp_adapters",
    "serp_envs": ROOT / "envs" / "serp_envs",
}
ROOMS = (
    "_core",  # compiled of the C++ files of all rooms
    "errors",
    "_util",
    "settings",
    "pddl",
    "model",
    "planning",
    "learning",
    "tasks",
    "agent",
    "runs",
    "authoring",
    "ui",
)
"""Rooms of `serp` from the bottom up: a room imports from itself and from the rooms before it."""


@cache
def tree(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def modules(package):
    return sorted(PACKAGES[package].rglob("*.py"))


def imports(path):
    """Full name of everything that a module imports, wherever in it."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize(
    ("package", "others"),
    [("serp", {"serp_adapters", "serp_envs"}), ("serp_envs", {"serp", "serp_adapters"})],
)
def test_imports_between_the_packages_go_one_way(package, others):
    found = [(path, name) for path in modules(package) for name in imports(path)]
    assert [each for each in found if each[1].partition(".")[0] in others] == []


def test_imports_inside_serp_go_one_way():
    height = {room: i for i, room in enumerate(ROOMS)}
    wrong = []
    for path in modules("serp"):
        part = path.relative_to(PACKAGES["serp"]).parts[0].removesuffix(".py")
        if part.startswith("__"):
            continue
        for name in imports(path):
            top, _, inner = name.partition(".")
            other = inner.partition(".")[0]
            if top == "serp" and other not in ("", part) and height[other] >= height[part]:
                wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert wrong == []


def test_includes_of_compiled_code_go_one_way():
    height = {room: i for i, room in enumerate(ROOMS)}
    wrong = []
    for path in sorted(PACKAGES["serp"].rglob("*.?pp")):
        part = path.relative_to(PACKAGES["serp"]).parts[0]
        if part not in height:
            continue  # serp/_core.cpp, which binds all rooms
        for name in re.findall(r'^\s*#\s*include\s+"([^"]+)"', path.read_text(), flags=re.M):
            top, other, *_ = (*name.split("/"), "")
            if top != "serp" or height.get(other, len(ROOMS)) > height[part]:
                wrong.append(f"{path.relative_to(ROOT)} includes {name}")
    assert wrong == []


def test_no_file_imports_itself_through_others():
    """Imports for types alone excepted, which are not carried out."""
    files = {
        ".".join(path.relative_to(root.parent).with_suffix("").parts): path
        for package, root in PACKAGES.items()
        for path in modules(package)
    }
    graph = nx.DiGraph()
    for name, path in files.items():
        graph.add_edges_from((name, other) for other in imported_files(path) if other in files)
    circles = [each for each in nx.strongly_connected_components(graph) if len(each) > 1]
    assert circles == []


def imported_files(path):
    """Modules, and names that may be modules, that a file imports when it runs."""
    typed = {
        id(inner)
        for node in ast.walk(tree(path))
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree(path)):
        if id(node) in typed:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def test_no_class_name_occurs_twice_in_serp():
    places = {}
    for path in modules("serp"):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert {name: where for name, where in places.items() if len(where) > 1} == {}
