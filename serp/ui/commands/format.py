"""`serp format`: a regular layout for PDDL files."""

from __future__ import annotations

import codecs
import difflib
import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural
from serp.errors import SerpError
from serp.ui.output import examples
from serp.ui.root import say

if TYPE_CHECKING:
    from serp.pddl.source import Source


@click.command(
    "format",
    epilog=examples(
        "serp format robot.pddl",
        "serp format domains/*.pddl --check",
        "serp format robot.pddl --diff",
    ),
)
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option("--check", is_flag=True, help="Write nothing; exit with 1 if a file would change.")
@click.option("--diff", is_flag=True, help="Write nothing; print what would change.")
def command(files: tuple[Path, ...], check: bool, diff: bool) -> int:
    """Lay files out regularly: indentation and blanks, and nothing else.

    Line breaks and comments are kept; only lines of more than 100 columns are broken. Other options
    do not exist, so that files of different authors look the same.
    """
    from serp.authoring.lint.formatting import formatted
    from serp.pddl.source import Source

    changed, wrong = 0, 0
    for file in files:
        try:
            before = Source.read(file)
            after = Source(before.name, formatted(before))
            if before.text == after.text:
                continue
            changed += 1
            if diff:
                click.echo(_difference(before, after), nl=False)
            elif check:
                click.echo(f"{file}: would change")
            else:
                write_changed(file, after.text)
                click.echo(f"{file}: formatted")
        except SerpError as error:
            say(str(error))
            wrong += 1
    done = "would change" if check or diff else "formatted"
    say(f"{plural(changed, 'file')} {done}, {len(files) - changed - wrong} as they should be")
    return 1 if wrong or (check and changed) else 0


def _difference(before: Source, after: Source) -> str:
    """Return the unified difference of two versions of a file."""
    old, new = (source.text.splitlines(keepends=True) for source in (before, after))
    lines = difflib.unified_diff(old, new, before.name, f"{after.name} (changed)")
    return "".join(line if line.endswith("\n") else f"{line}\n" for line in lines)


def write_changed(path: Path, text: str) -> None:
    """Replace a file atomically, but for its byte order mark and its mode."""
    from serp._util.files import write_durably

    target = Path(os.path.realpath(path))
    mark = codecs.BOM_UTF8 if target.read_bytes().startswith(codecs.BOM_UTF8) else b""
    mode = target.stat().st_mode
    write_durably(target, mark + text.encode())
    if target.stat().st_mode != mode:
        target.chmod(mode)
