"""`serp lsp`: what `serp check` knows, in an editor, while a file is being written."""

from __future__ import annotations

import click

from serp.errors import needs_extra
from serp.ui.output import examples


@click.command("lsp", epilog=examples("serp lsp", "pip install 'serp[lsp]'"))
def command() -> None:
    """Serve an editor over standard input and output, by the Language Server Protocol.

    Editors start this command themselves; docs/how-to/editors.md says how each is told.
    """
    with needs_extra("lsp", "`serp lsp`"):
        from serp.authoring.language_server.server import server

    server.start_io()
