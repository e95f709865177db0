"""The state that decisions are shown for: a slider for each number, a switch for each predicate."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from nicegui import ui

from serp.studio.pages.live import Live, Pane
from serp.studio.session import Request, Session
from serp.studio.shown_state import Control
from serp.studio.view import View

Changed = Callable[[Any], None]

_MOST = 60
"""Fluents that are shown at a time."""


class StatePane(Pane):
    """Sliders and switches."""

    def __init__(self, session: Session, live: Live) -> None:
        super().__init__(session, live)
        self._controls: tuple[Control, ...] = ()
        self._setters: dict[str, list[Any]] = {}
        self._filter = ""
        with ui.element("div").classes("serp-state").props('role="group" aria-label="State"'):
            self._search = ui.input(placeholder="find a fluent", on_change=self._filtered).props(
                "dense clearable"
            )
            self._search.set_visibility(False)
            self._switches = ui.element("div").classes("serp-switches")
            self._grid = ui.element("div").classes("serp-controls")
            self._more = ui.label().classes("serp-faint")
        live.shows(self.show)

    def show(self, request: Request, view: View) -> None:
        """Show the controls of a view."""
        if view.decision is None:
            return
        controls = view.decision.controls
        same = [_kind(each) for each in controls] == [_kind(each) for each in self._controls]
        self._controls = controls
        if not same:
            self._build()
            return
        for control in controls:
            for element in self._setters.get(control.name, ()):
                # What is being dragged or typed is ahead of this view.
                newest = self._session.shown.values.get(control.name, control.value)
                value = float(newest) if control.numeric else bool(newest)
                if element.value != value:
                    element.value = value

    def _filtered(self, event: Any) -> None:
        self._filter = (event.value or "").lower()
        self._build()

    def _build(self) -> None:
        wanted = [each for each in self._controls if self._filter in each.name]
        self._search.set_visibility(len(self._controls) > 12)
        self._setters = {}
        self._grid.clear()
        self._switches.clear()
        for control in wanted[:_MOST]:
            changed = functools.partial(self._changed, control)
            make = self._slider if control.numeric else self._switch
            with self._grid if control.numeric else self._switches:
                self._setters[control.name] = make(control, changed)
        left = len(wanted) - _MOST
        self._more.set_text(f"… and {left:,} more" if left > 0 else "")

    def _switch(self, control: Control, changed: Changed) -> list[Any]:
        switch = ui.switch(control.name, value=bool(control.value), on_change=changed)
        return [switch.props("dense").classes("serp-switch")]

    def _slider(self, control: Control, changed: Changed) -> list[Any]:
        with ui.element("div").classes("serp-control"):
            ui.label(control.name).classes("serp-name").tooltip(control.name)
            slider = ui.slider(
                min=control.low, max=control.high, step=control.step, value=control.value,
                on_change=changed,
            )  # fmt: skip
            number = ui.number(value=control.value, format="%.4g", on_change=changed)
            for element, what in ((slider, "slider"), (number, "number")):
                element.props("dense")
                element.props["aria-label"] = f"{control.name}, {what}"
            number.props("borderless").classes("serp-value")
        return [slider, number]

    def _changed(self, control: Control, event: Any) -> None:
        value = event.value
        if value is None:
            return
        known = self._session.shown.values.get(control.name, control.value)
        if float(value) != float(known):
            self._session.set_fluent(control.name, float(value) if control.numeric else bool(value))
            self._live.changed()


def _kind(control: Control) -> tuple[object, ...]:
    return control.name, control.numeric, control.low, control.high
