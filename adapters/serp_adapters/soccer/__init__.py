"""The soccer tasks: the defender of the SErP paper, section 4.2, and a corner kick.

Importing this package without pymunk raises `serp.errors.MissingExtra`.
"""

from __future__ import annotations

from importlib.util import find_spec

from serp.errors import MissingExtra

if find_spec("pymunk") is None:
    raise MissingExtra("robot soccer (`soccer`, `corner-kick`)", "soccer")

from serp_adapters.soccer.defender import task

__all__ = ["task"]
