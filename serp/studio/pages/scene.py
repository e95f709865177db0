"""Where the state comes from, and what it looks like: the initial state, or a played step."""

from __future__ import annotations

from typing import Any, Final

from nicegui import run, ui

from serp.errors import SerpError
from serp.studio.pages.live import Live, Pane, busy
from serp.studio.pages.state import StatePane
from serp.studio.session import PROBLEM, Request, Session
from serp.studio.view import View

_MOST_MARKERS: Final = 50


class ScenePane(Pane):
    """Buttons that choose the state, the steps of the episode, two pictures, and the fluents."""

    def __init__(self, session: Session, live: Live) -> None:
        super().__init__(session, live)
        with ui.element("section").classes("serp-panel").props('aria-label="Situation"'):
            with ui.element("div").classes("serp-row"):
                if PROBLEM in session.documents:
                    ui.button("Initial state", on_click=self._initial).props(
                        "dense outline no-caps"
                    )
                self._play = ui.button("Play an episode", on_click=self.play).props(
                    "dense outline no-caps"
                )
                self._seed = ui.number("seed", value=0, min=0, precision=0).props("dense")
                self._seed.classes("serp-seed")
                if session.recorded is not None:
                    self._episode = ui.number("episode", value=1, min=1, precision=0)
                    self._episode.props("dense").classes("serp-seed")
                    ui.button("Show", on_click=self._show_episode).props("dense outline no-caps")
                    ui.button("Next veto", on_click=self._next_veto).props("dense outline no-caps")
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

        What prevents it is told, unless nobody has asked for it.
        """
        with busy(self._play):
            try:
                played = await run.io_bound(self._session.player(int(self._seed.value or 0)))
            except SerpError as error:
                if not unasked:  # a place in a file is told beside the text, with its line
                    ui.notify(str(error).partition("\n")[0], type="negative", multi_line=True)
                return
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
        self._steps.props["markers"] = len(played.steps) <= _MOST_MARKERS
        self._steps.set_visibility(len(played.steps) > 1)
        self._steps.set_value(self._session.step)
        self._live.changed()

    def _show_episode(self) -> None:
        try:
            self._session.show_episode(int(self._episode.value or 1))
        except SerpError as error:
            ui.notify(str(error), type="warning", multi_line=True)
        else:
            self._taken()

    def _next_veto(self) -> None:
        if self._session.show_next_veto():
            self._taken()
        else:
            ui.notify("Nothing was refused in this run.")

    async def begin(self) -> None:
        """Show steps at the beginning: of the run, or else of an episode of the task."""
        if self._session.played is not None:
            self._taken()
        elif self._session.recorded is not None:
            if self._session.show_next_veto():
                self._taken()
            else:
                self._show_episode()
        elif self._session.task is not None:
            await self.play(unasked=True)

    def _initial(self) -> None:
        self._session.show_initial()
        self._live.changed()

    def _chosen(self, event: Any) -> None:
        if self._session.played is not None and event.value != self._session.step:
            self._session.show_step(int(event.value))
            self._live.changed()

    def show(self, request: Request, view: View) -> None:
        """Show where the state comes from, and its pictures."""
        session, played = self._session, self._session.played
        as_played = session.as_played
        origin = request.shown.origin
        if session.step is not None and played is not None:
            action = played.steps[session.step].action
            origin = f"{played.name}, step {session.step} of {len(played.steps) - 1}"
            origin += f", {action}" if action and as_played else ""
        changed = request.shown.values and not as_played
        self._origin.set_text(origin + (", changed by hand" if changed else ""))
        if view.decision is not None:  # else the last one stays, as the decision does
            self._drawing.set_content(_figure(view.drawing, "drawn from the fluents"))
        picture = ""
        if session.step is not None and played is not None:
            url = played.steps[session.step].picture
            if url:
                said = "the environment at this step"
                said += "" if as_played else "; the fluents have been changed since"
                picture = _figure(f'<img src="{url}" alt="{said}">', said)
        self._picture.set_content(picture)
        self._picture.classes(
            add="" if as_played else "serp-stale", remove="serp-stale" if as_played else ""
        )


def _figure(picture: str, said: str) -> str:
    return f"<figure>{picture}<figcaption>{said}</figcaption></figure>" if picture else ""
