"""The corner-kick task, for installations whose entry point still names this module."""

from __future__ import annotations

from serp_adapters.soccer.corner_kick import task

__all__ = ["task"]
