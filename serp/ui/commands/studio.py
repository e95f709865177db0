"""`serp studio`: a domain file in the browser, live."""

from __future__ import annotations

from pathlib import Path

import click

from serp.ui.asked import asked_own_task
from serp.ui.options import own_task_option
from serp.ui.output import examples
from serp.ui.root import say


@click.command(
    "studio",
    epilog=examples(
        "serp studio soccer",
        "serp studio my/world.pddl --port 8400 --no-browser",
    ),
)
@click.argument("name", metavar="FILE|NAME|RUN")
@own_task_option
@click.option("--port", type=click.IntRange(0, 65535), default=0, metavar="N",
              help="Port on this machine.  [default: any that is free]")  # fmt: skip
@click.option("--no-browser", is_flag=True, help="Only print the address.")
def command(name: str, port: int, no_browser: bool) -> None:
    """Edit a domain file in the browser and see at every keystroke what it means.

    Beside the text stand what is wrong in it, the planner's decision in a state of your choice, and
    its planning graph. The page is served on this machine alone, at an address with a token; it
    loads nothing from the network. Files are saved in the working folder alone.

    With RUN, the folder of a training, its copy of the file is opened.

    Ctrl-C ends it.
    """
    from serp.errors import needs_extra

    with needs_extra("studio", "serp studio"):
        from serp.ui.studio.serving import serve
    from serp.ui.studio.session import open_session

    session = open_session(name, Path.cwd(), asked_own_task())
    say("serp studio runs at this address; Ctrl-C ends it.")
    serve(session, port, browser=not no_browser)
