"""What people see: the command line, reports, pictures, the studio."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command on arguments, by default what the user typed; exit with its status."""
    from serp.ui.root import serp

    serp(arguments, prog_name="serp")
    raise AssertionError("click exits by itself")
