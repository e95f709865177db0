"""The planner's decision: the table of actions and the planning graph."""

from __future__ import annotations

from nicegui import ui

from serp._util.templates import render
from serp._util.text import percent, readable
from serp.agent.sentences import kind_of_return, line_of_run, runs_of
from serp.ui.studio.pages.live import Jump, Live, follow_places
from serp.ui.studio.view import View


class DecisionPane:
    """Shows decisions; where an error leaves none, the last one stays, faint."""

    def __init__(self, live: Live, jump: Jump) -> None:
        self._root = ui.element("section").classes("serp-decision").props('aria-label="Decision"')
        with self._root:
            self._table = ui.html()
            self._verdict = ui.label().classes("serp-faint").props('role="status"')
            self._graph = ui.html().classes("serp-graph").props('tabindex="0"')
        follow_places(self._table, jump)
        live.shows(self.show)

    def show(self, view: View) -> None:
        """Show the decision of a view."""
        decision = view.decision
        if decision is None:
            self._root.classes(add="serp-stale")
            if not self._verdict.text:
                self._verdict.set_text("The file has errors, so there is no decision yet.")
            return
        self._root.classes(remove="serp-stale")
        account = decision.account
        table = render(
            "serp.ui.studio.pages",
            "decision.html.j2",
            {"readable": readable, "percent": percent},
            kind=kind_of_return(account.partial),
            shown=decision.shown,
            chosen=account.chosen,
            more=len(account.alternatives) - len(decision.shown),
            runs_of=runs_of,
            line_of_run=line_of_run,
        )
        self._table.set_content(table)
        self._verdict.set_text(decision.verdict)
        self._graph.set_content(decision.graph)
