"""The pages of the documentation: their blocks, tables and marks.

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

Python blocks run in the order of their page and share their names. A `text` block right after
one of them, or after commands that are run, is what it prints.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "docs" / "examples"
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
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


def blocks(page):
    text = page.read_text(encoding="utf-8")
    found, end = [], 0
    for match in FENCE.finditer(text):
        mark = MARK.search(text[: match.start()])
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(match[1], match[2], mark[1] if mark else "", line, match.start() - end))
        end = match.end()
    return found


def prose(page):
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def tables(kind):
    """Every table under a mark `kind: argument`, as (page, argument, rows without the head)."""
    return [
        pytest.param(page, match[1], rows(match[2]), id=f"{page.stem}-{match[1]}-{number}")
        for page in PAGES
        for number, match in enumerate(
            re.finditer(rf"<!-- {kind}: (.+?) -->\n((?:\|.*\n)+)", page.read_text("utf-8"))
        )
    ]


def rows(table):
    """The cells of a table without its head; `\\|` is a bar inside a cell."""
    lines = [re.split(r"(?<!\\)\|", line)[1:-1] for line in table.splitlines()[2:]]
    return [[cell.strip().replace("\\|", "|") for cell in line] for line in lines]


def code(cell):
    """What stands in the first pair of backquotes."""
    match = re.match(r"`([^`]+)`", cell)
    assert match, f"no code in {cell!r}"
    return match[1]


def name_of(page):
    return page.relative_to(ROOT).as_posix()
