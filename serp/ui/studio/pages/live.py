"""Keeps the page up with the session: one view at a time, always of the newest state."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import background_tasks, run, ui

from serp.ui.studio.session import Session
from serp.ui.studio.view import View

Shown = Callable[[View], None]
Jump = Callable[[str, int, int], None]
"""Shows a line and a column of a file."""


class Live:
    """Asks for a view after every change and hands it to the panes.

    A change that comes while a view is computed is looked at next; those between are left out, so
    that a slow file delays what is shown and never the typing.

    Attributes:
        closed: Whether the page no longer owns the session; it then may change nothing.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shown: list[Shown] = []
        self._wanted = asyncio.Event()
        self.closed = False

    def shows(self, shown: Shown) -> None:
        """Add a function that is called with every view."""
        self._shown.append(shown)

    def begin(self) -> None:
        """Begin to follow the session."""
        self._wanted.set()
        background_tasks.create(self._follow(), name="studio: views")

    def changed(self) -> None:
        """Say that the session has changed."""
        self._wanted.set()

    def close(self) -> None:
        """Follow no longer."""
        self.closed = True
        self._wanted.set()

    async def _follow(self) -> None:
        while True:
            await self._wanted.wait()
            self._wanted.clear()
            if self.closed:
                return
            view = await run.io_bound(self._session.asked())
            if view is not None and not self.closed:
                for shown in self._shown:
                    shown(view)


def follow_places(element: ui.html, jump: Jump) -> None:
    """Let clicks in an element lead to the places of its parts, `data-place="LINE:COLUMN:FILE"`."""

    def clicked(event: Any) -> None:
        line, column, file = (*str(event.args).split(":", 2), "", "")[:3]
        if line.isdecimal() and column.isdecimal():
            jump(file, int(line), int(column))

    clicks = "(e) => { const b = e.target.closest('[data-place]'); if (b) emit(b.dataset.place) }"
    element.on("click", clicked, js_handler=clicks)


def button(text: str, on_click: Callable[..., object]) -> ui.button:
    """Return an outlined button."""
    return ui.button(text, on_click=on_click).props("dense outline no-caps")
