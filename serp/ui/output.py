"""Writing: tables and lines (in colour on a terminal, plain text elsewhere), examples in help."""

from __future__ import annotations

import difflib
import itertools
import sys
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import click

from serp._util import terminal
from serp._util.terminal import visible
from serp._util.text import readable

if TYPE_CHECKING:
    from rich.console import Console

    from serp.model.transition_model import TransitionModel


def examples(*lines: str) -> str:
    """Return the end of a command's help; no line is wrapped, so that each can be copied."""
    return "\n".join(["\b", "Examples:", *(f"  {line}" for line in lines)])


def _open_console() -> Console:
    console = terminal.open_console()
    if not console.is_terminal:
        console.width = 10_000  # in a file or pipe nothing is wrapped or cut
    return console


def show(text: str = "", style: str | None = None) -> None:
    """Print a text as it stands; `style` is one of rich's."""
    _open_console().print(text, style=style)


def print_table(
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    styles: Sequence[str] = (),
    right: Iterable[int] = (),
) -> None:
    """Print a table without lines.

    The head is omitted if all titles are empty. `styles` are rich's styles of the rows, `right` the
    columns that are aligned to the right.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    console, to_the_right = _open_console(), set(right)
    table = Table(
        box=box.SIMPLE_HEAD if any(head) else None,
        show_header=any(head),
        pad_edge=False,
        show_edge=False,
        header_style="bold",
    )
    for column, title in enumerate(head):
        table.add_column(
            Text(visible(title)),
            justify="right" if column in to_the_right else "left",
            overflow="fold",
        )
    for row, cells in enumerate(rows):
        style = styles[row] if styles else None
        table.add_row(*(Text(visible(cell)) for cell in cells), style=style)
    if console.is_terminal:
        console.print(table)
        return
    with console.capture() as captured:
        console.print(table)
    for line in captured.get().splitlines():
        console.print(line.rstrip())


def print_next(*commands: tuple[str, str]) -> None:
    """Print commands that may follow, each with what it is for."""
    show("\nNext:")
    print_table(("", ""), [(f"  {command}", why) for command, why in commands])


def print_difference(
    old: str, new: str, names: tuple[str, str] | None = None, *, context: int = 2, indent: str = ""
) -> None:
    """Print the unified difference of two versions of a text, below their names if given."""
    colours = {"+": "green", "-": "red", "@": "cyan"}
    lines = difflib.unified_diff(
        old.splitlines(), new.splitlines(), *(names or ("", "")), n=context, lineterm=""
    )
    for line in itertools.islice(lines, 0 if names else 2, None):
        bold = names is not None and line.startswith(("+++", "---"))
        click.secho(indent + visible(line), fg=colours.get(line[:1]), bold=bold)


def print_json(value: Any) -> None:
    """Print JSON that every reader takes: NaN and infinities become null."""
    from serp._util.files import finite, json_text

    print_result(json_text(finite(value)).rstrip("\n"))


def print_result(text: object) -> None:
    """Print a line for programs to read, such as a path: as it is, but on a terminal visibly."""
    click.echo(visible(str(text)) if sys.stdout.isatty() else str(text))


def changes_between(
    model: TransitionModel, before: Sequence[float], after: Sequence[float]
) -> list[str]:
    """Return `fluent = value` of the fluents that differ between two states."""
    return [
        f"{fluent.name} = {readable(new if fluent.numeric else bool(new))}"
        for fluent, old, new in zip(model.fluents, before, after, strict=True)
        if old != new
    ]
