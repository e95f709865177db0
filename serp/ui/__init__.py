"""What people see: the command line, reports, pictures, the studio."""

from __future__ import annotations

import gc
from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command on arguments, by default what the user typed; exit with its status."""
    from serp.ui.root import serp

    gc.set_threshold(100_000, 50, 100)  # a large file is millions of objects, and none is garbage
    serp(arguments, prog_name="serp")
