"""The state that decisions are shown for: a slider for each number, a switch for each predicate."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from nicegui import run, ui

from serp.errors import SerpError
from serp.ui.studio.episodes import play
from serp.ui.studio.pages.live import Live, button
from serp.ui.studio.session import PROBLEM, Session
from serp.ui.studio.view import Control, View


class StatePane:
    """Sliders and switches."""

    def __init__(self, session: Session, live: Live) -> None:
        self._session, self._live = session, live
        self._controls: list[Control] = []
        self._elements: dict[str, Any] = {}
        with ui.element("div").classes("serp-state").props('role="group" aria-label="State"'):
            self._switches = ui.element("div").classes("serp-switches")
            self._grid = ui.element("div").classes("serp-controls")
            self._more = ui.label().classes("serp-faint")
        live.shows(self.show)

    def show(self, view: View) -> None:
        """Show the controls of a view."""
        if view.decision is None:
            return
        before, self._controls = self._controls, view.decision.controls
        if [replace(c, value=0) for c in before] != [replace(c, value=0) for c in self._controls]:
            self._build()
            return
        for control in self._controls:
            # What is being dragged or typed is ahead of this view.
            newest = self._session.values.get(control.name, control.value)
            if control.name in self._elements:
                value = float(newest) if control.numeric else bool(newest)
                self._elements[control.name].set_value(value)

    def _build(self) -> None:
        most_fluents = 60
        self._elements = {}
        self._grid.clear()
        self._switches.clear()
        for control in self._controls[:most_fluents]:
            changed = functools.partial(self._changed, control)
            make = self._slider if control.numeric else self._switch
            with self._grid if control.numeric else self._switches:
                self._elements[control.name] = make(control, changed)
        hidden = len(self._controls) - most_fluents
        self._more.set_text(f"… and {hidden:,} more" if hidden > 0 else "")

    def _switch(self, control: Control, changed: Callable[[Any], None]) -> ui.switch:
        switch = ui.switch(control.name, value=bool(control.value), on_change=changed)
        return switch.props("dense").classes("serp-switch")

    def _slider(self, control: Control, changed: Callable[[Any], None]) -> ui.slider:
        with ui.element("div").classes("serp-control"):
            ui.label(control.name).classes("serp-name").tooltip(control.name)
            slider = ui.slider(
                min=control.low, max=control.high, step=control.step, value=control.value,
                on_change=changed,
            )  # fmt: skip
            number = ui.number(format="%.4g").bind_value(slider)
            for element, what in ((slider, "slider"), (number, "number")):
                element.props("dense")
                element.props["aria-label"] = f"{control.name}, {what}"
            number.props("borderless").classes("serp-value")
        return slider

    def _changed(self, control: Control, event: Any) -> None:
        value = event.value
        if value is None:
            return
        known = self._session.values.get(control.name, control.value)
        if float(value) != float(known):
            set_to = float(value) if control.numeric else bool(value)
            self._session.values = {**self._session.values, control.name: set_to}
            self._live.changed()


class ScenePane:
    """Buttons that choose the state, the steps of the episode, two pictures, and the fluents."""

    def __init__(self, session: Session, live: Live) -> None:
        self._session, self._live = session, live
        with ui.element("section").classes("serp-panel").props('aria-label="Situation"'):
            with ui.element("div").classes("serp-row"):
                if PROBLEM in session.documents:
                    button("Initial state", self._initial)
                self._play = button("Play an episode", self.play)
                self._seed = ui.number("seed", value=0, min=0, precision=0).props("dense")
                self._seed.classes("serp-seed")
                self._origin = ui.label().classes("serp-faint")
            self._steps = ui.slider(min=0, max=1, step=1, value=0, on_change=self._chosen)
            self._steps.props('dense snap aria-label="Step of the episode"')
            self._steps.set_visibility(False)
            with ui.element("div").classes("serp-situation"):
                with ui.element("div").classes("serp-scenes"):
                    self._drawing = ui.html().classes("serp-drawing")
                    self._picture = ui.html().classes("serp-picture")
                StatePane(session, live)
        live.shows(self.show)

    async def play(self, *, unasked: bool = False) -> None:
        """Play an episode in the environment, in a thread, and show its steps.

        What prevents it is shown, unless it was unasked.
        """
        self._play.props("loading")
        try:
            session, seed = self._session, int(self._seed.value or 0)
            of = session.task, session.version, session.surroundings
            played = await run.io_bound(play, *of, seed)
        except SerpError as error:
            if not unasked:  # a place in a file stands beside the text, with its line
                ui.notify(str(error).partition("\n")[0], type="negative", multi_line=True)
            return
        finally:
            self._play.props(remove="loading")
        if self._live.closed:
            return
        self._session.take(played)
        if played.note:
            ui.notify(played.note, multi_line=True)
        self._taken()

    def _taken(self) -> None:
        """Show the steps of an episode that was taken over."""
        played = self._session.played
        assert played is not None
        self._steps.props(f"max={len(played.steps) - 1}")
        self._steps.props["markers"] = len(played.steps) <= 50
        self._steps.set_visibility(len(played.steps) > 1)
        self._steps.set_value(self._session.step)
        self._live.changed()

    async def begin(self) -> None:
        """Show the episode that was played last; without one, play one unless a state is shown."""
        if self._session.played is not None:
            self._taken()
        elif self._session.begins_with_episode:
            await self.play(unasked=True)

    def _initial(self) -> None:
        self._session.show_initial()
        self._live.changed()

    def _chosen(self, event: Any) -> None:
        if self._session.played is not None and event.value != self._session.step:
            self._session.show_step(int(event.value))
            self._live.changed()

    def show(self, view: View) -> None:
        """Show where the state comes from, and its pictures."""
        session, played = self._session, self._session.played
        by_hand = session.by_hand
        step = None if session.step is None or played is None else played.steps[session.step]
        action = f", {step.action}" if step is not None and step.action else ""
        self._origin.set_text(session.origin + (", changed by hand" if by_hand else action))
        if view.decision is not None:  # else the last one stays, as the decision does
            self._drawing.set_content(_figure(view.drawing, "drawn from the fluents"))
        picture = ""
        if step is not None and step.picture:
            caption = "the environment at this step"
            caption += "; the fluents have been changed since" if by_hand else ""
            picture = _figure(f'<img src="{step.picture}" alt="{caption}">', caption)
        self._picture.set_content(picture)
        self._picture.classes(
            add="serp-stale" if by_hand else "", remove="" if by_hand else "serp-stale"
        )


def _figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{caption}</figcaption></figure>" if picture else ""
