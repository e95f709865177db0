"""Who owns the studio when several tabs show it."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

pytest.importorskip("nicegui")
from nicegui import Client, ui
from nicegui.testing import user_simulation

from serp.ui.studio.pages.page import show_page
from serp.ui.studio.session import open_session

ROOT = Path(__file__).resolve().parents[4]


def test_only_the_tab_that_came_last_changes_the_session(tmp_path: Path) -> None:
    session = open_session(str(ROOT / "domains" / "hill.pddl"), tmp_path)

    async def take_turns() -> None:
        async with user_simulation(root=lambda: show_page(session)) as user:
            await user.http_client.get("/")  # a tab without its websocket
            (away,) = Client.instances.values()
            editor = next(e for e in away.elements.values() if isinstance(e, ui.codemirror))
            await user.open("/")
            assert session.owner == 2
            assert editor.id not in away.elements  # what it still sends finds nobody
            assert any(
                isinstance(each, ui.button) and each.text == "Use it here"
                for each in away.elements.values()
            )
            here = (
                each for each in user.client.elements.values() if isinstance(each, ui.codemirror)
            )
            next(here).set_value("; mine")
            assert session.documents["domain"].text == "; mine"

    asyncio.run(take_turns())
