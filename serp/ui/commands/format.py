"""`serp format`: a regular layout for PDDL files."""

from __future__ import annotations

from pathlib import Path

import click

from serp._util.text import plural
from serp.errors import SerpError
from serp.ui.output import examples
from serp.ui.root import say


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
    from serp.authoring.lint.fixing import difference, write_changed
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
                click.echo(difference(before, after), nl=False)
            elif check:
                click.echo(f"{file}: would change")
            else:
                write_changed({file: after.text})
                click.echo(f"{file}: formatted")
        except SerpError as error:
            say(str(error))
            wrong += 1
    done = "would change" if check or diff else "formatted"
    say(f"{plural(changed, 'file')} {done}, {len(files) - changed - wrong} as they should be")
    return 1 if wrong or (check and changed) else 0
