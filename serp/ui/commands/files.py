"""Commands that write domain files, or open them elsewhere: `new`, `format`, `lsp`, `studio`."""

from __future__ import annotations

import codecs
import io
import os
from pathlib import Path

import click

from serp._util.text import plural
from serp.errors import SerpError, needs_extra
from serp.ui.options import asked_own_task, command, own_task_option
from serp.ui.output import print_difference, print_next, show
from serp.ui.root import say


@command(
    "serp new delivery",
    "serp new mountain --env MountainCar-v0",
    "serp new my-robot --env my_env.py:Robot",
)
@click.argument("name", type=click.Path(path_type=Path))
@click.option("--env", metavar="ID|FILE.py:CLASS|FILE.py:FUNCTION",
              help="A Gymnasium environment: ID, PACKAGE:ID or your own class.")  # fmt: skip
def new(name: Path, env: str | None) -> None:
    """Write the first files of the task NAME; no existing file is overwritten.

    With --env, NAME.pddl has the environment's actions and the numbers of its observations, and
    NAME.py is the task. Add what you know about the environment to NAME.pddl; `serp check` and
    `serp plan-and-learn` work before that, too.

    Without --env, NAME.pddl is an example for `serp play`, whose world is the file itself.

    NAME.scenarios says what you expect of the file; `serp test` checks this.
    """
    from serp.authoring.scaffold import new_task

    files = new_task(name, env)
    domain = files[0]
    for file in files:
        show(f"written: {file}")
    rows = [
        (f"serp play {domain}", "step it by hand; `?` asks the planner"),
        (f"serp check {domain}", "check the file after each change"),
        (f"serp test {domain}", "check that the planner does what you expect"),
        (f"serp plan-and-learn --domain {domain}", "let a learner practise in it"),
    ]
    if env is not None:
        task = files[1]
        rows = [
            (str(domain), "write what the actions change, what is good, and what must not happen"),
            (f"serp check {domain} --task {task}", "check both files after each change"),
            (f"serp plan --task {task} --observe", "show what the planner would do"),
            (f"serp plan-and-learn --task {task}", "train"),
        ]
    print_next(*rows)


@command(
    "serp format robot.pddl", "serp format domains/*.pddl --check", "serp format robot.pddl --diff"
)
@click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
@click.option("--check", is_flag=True, help="Write nothing; exit status 1 if a file would change.")
@click.option("--diff", is_flag=True, help="Write nothing; print what would change.")
def format(files: tuple[Path, ...], check: bool, diff: bool) -> int:
    """Correct the indentation and spaces of files, and nothing else.

    Line breaks and comments are kept. The style has no options, so files of different authors look
    the same.
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
            if diff:
                print_difference(before.text, after.text, (before.name, f"{after.name} (changed)"))
            elif check:
                click.echo(f"{file}: would change")
            else:
                write_changed(file, after.text)
                click.echo(f"{file}: formatted")
            changed += 1
        except SerpError as error:
            say(str(error))
            wrong += 1
    done = "would change" if check or diff else "formatted"
    say(f"{plural(changed, 'file')} {done}; {len(files) - changed - wrong} are already formatted")
    return 1 if wrong or (check and changed) else 0


def write_changed(path: Path, text: str) -> None:
    """Replace a file atomically, but for its byte order mark."""
    from serp._util.files import write_durably

    target = Path(os.path.realpath(path))
    mark = codecs.BOM_UTF8 if target.read_bytes().startswith(codecs.BOM_UTF8) else b""
    write_durably(target, mark + text.encode())


@command("pip install 'serp[lsp]'", "serp lsp")
def lsp() -> None:
    """Serve an editor over the Language Server Protocol.

    The editor starts this command itself; docs/how-to/editors.md says how to set up each editor.
    """
    with needs_extra("lsp", "`serp lsp`"):
        from serp.authoring.language_server.server import Input, server

    server.start_io(Input(io.FileIO(0, closefd=False)))


@command(
    "serp studio soccer",
    "serp studio my/world.pddl --port 8400 --no-browser",
    "serp studio runs/seven --step 1204",
)
@click.argument("name", metavar="FILE|NAME|RUN")
@own_task_option
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N",
              help="Port on this machine.  [default: any free port]")  # fmt: skip
@click.option("--no-browser", is_flag=True, help="Only print the address.")
@click.option("--step", type=click.IntRange(min=0), metavar="N",
              help="Begin with step N of RUN, as numbered in decisions.csv.")  # fmt: skip
def studio(name: str, port: int, no_browser: bool, step: int | None) -> None:
    """Edit a domain file in the browser and see what it means.

    The page shows the text, its mistakes, the planner's decision in a state of your choice, and the
    planning graph. Only this machine can open the page, at an address with a token; the page loads
    nothing from the network. Files are saved only in the working folder.

    If RUN, the folder of a run, is given, the run's copy of the file is opened.

    Ctrl-C ends the studio.
    """
    with needs_extra("studio", "serp studio"):
        from serp.ui.studio.serving import serve
    from serp.ui.studio.session import open_session

    session = open_session(name, Path.cwd(), asked_own_task(), step)
    say("Open this address to use serp studio; Ctrl-C ends it.")
    serve(session, port, browser=not no_browser)
