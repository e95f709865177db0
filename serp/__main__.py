"""`python -m serp`: the same as the command `serp`."""

from __future__ import annotations

from serp.ui import main

if __name__ == "__main__":
    main()
