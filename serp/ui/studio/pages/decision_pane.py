"""The planner's decision: the table of actions and the planning graph."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any

from nicegui import ui

from serp._util.text import percent, readable
from serp.agent.causes import Cause
from serp.agent.explanation import Alternative
from serp.agent.sentences import kind_of_return, line_of_run, runs_of
from serp.ui.studio.pages.live import Live
from serp.ui.studio.view import Request, View


class DecisionPane:
    """Shows decisions; where an error leaves none, the last one stays, faint.

    `jump` shows a line and column of a file.
    """

    def __init__(self, live: Live, jump: Callable[[str, int, int], None]) -> None:
        self._jump = jump
        with (
            ui.element("section")
            .classes("serp-decision")
            .props('aria-label="Decision"') as self._root
        ):
            self._table = ui.html()
            self._table.on(
                "click",
                self._clicked,
                js_handler="(e) => { const b = e.target.closest('[data-place]'); "
                "if (b) emit(b.dataset.place) }",
            )
            self._verdict = ui.label().classes("serp-faint").props('role="status"')
            self._graph = ui.html().classes("serp-graph").props('tabindex="0"')
        live.shows(self.show)

    def _clicked(self, event: Any) -> None:
        line, column, file = (*str(event.args).split(":", 2), "", "")[:3]
        if line.isdecimal() and column.isdecimal():
            self._jump(file, int(line), int(column))

    def show(self, request: Request, view: View) -> None:
        """Show the decision of a view."""
        columns = (
            "<thead><tr><th></th><th>action</th><th>reward</th><th>{}</th><th>risk</th>"
            "<th>why</th></tr></thead>"
        )
        decision = view.decision
        if decision is None:
            self._root.classes(add="serp-stale")
            if not self._verdict.text:
                self._verdict.set_text("The file has errors, so there is no decision yet.")
            return
        self._root.classes(remove="serp-stale")
        account = decision.account
        rows = "".join(_row(each, account.chosen) for each in decision.shown)
        if more := len(account.alternatives) - len(decision.shown):
            rows += f'<tr><td></td><td colspan="5">… and {more:,} more</td></tr>'
        head = columns.format(kind_of_return(account.partial))
        self._table.set_content(f'<table class="serp-actions">{head}<tbody>{rows}</tbody></table>')
        self._verdict.set_text(decision.verdict)
        self._graph.set_content(decision.graph)


def _row(action: Alternative, chosen: int | None) -> str:
    taken = action.action == chosen
    harm = action.applicable and bool(action.path_risk)
    kinds = ["serp-chosen"] * taken + ["serp-harm"] * harm
    kinds += ["serp-out"] * (not action.applicable)
    value = action.best_return if action.applicable else None
    risk = percent(action.path_risk) if harm else ""
    numbers = "".join(
        f'<td class="serp-number">{escape(cell)}</td>'
        for cell in (readable(action.reward), readable(value), risk)
    )
    mark = '<span aria-label="chosen">➜</span>' if taken else ""
    return (
        f'<tr class="{" ".join(kinds)}"><td>{mark}</td><td>{escape(action.name)}</td>{numbers}'
        f"<td>{_why(action, 6 if taken else 3)}</td></tr>"
    )


def _why(action: Alternative, most: int) -> str:
    """Return what of the file is behind an action, each with a way there and its whole sentence."""
    runs = runs_of((*action.causes, *action.ahead))
    items = "".join(map(_item, runs[:most]))
    if len(runs) > most:
        items += f"<li>… and {len(runs) - most} more</li>"
    remark = escape(action.remark) if not action.causes else ""
    return f'{remark}<ul class="serp-causes">{items}</ul>' if items else remark


def _item(run: list[list[Cause]]) -> str:
    whole, place = line_of_run(run), run[0][0].place
    text = whole.partition(" [")[0]
    if place is None:
        return f"<li>{escape(text)}</li>"
    at = f"{place.line}:{place.column}:{place.file}"
    return (
        f'<li><button type="button" data-place="{escape(at, quote=True)}" '
        f'title="{escape(whole, quote=True)}">{escape(text)} · line {place.line}</button></li>'
    )
