"""The studio in a real browser: what is typed, clicked and dragged, and who is kept out."""

from __future__ import annotations

import shutil
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.serp.studio.browser import CHROMIUM, chromium, served

pytest.importorskip("playwright")
ROOT = Path(__file__).resolve().parents[3]


def status(address: str, **headers: str) -> int:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
def test_the_page_follows_what_is_typed_and_set(tmp_path: Path) -> None:
    file = tmp_path / "hill.pddl"
    shutil.copy(ROOT / "domains" / "hill.pddl", file)
    with served("hill.pddl", tmp_path) as address:
        assert status(address.partition("/?")[0] + "/") == 403
        assert status(address, Host="evil.example") == 403
        with chromium(address, color_scheme="dark") as (page, elsewhere):
            page.wait_for_selector("body.body--dark")
            assert "token" not in page.url
            page.wait_for_selector(".serp-picture img")

            # A mistake is underlined, listed with its place, and leads there.
            page.locator(".cm-content").click()
            page.keyboard.press("Control+End")
            page.keyboard.type("oops")
            page.wait_for_selector(".serp-mark-error:has-text('oops')")
            page.locator(".serp-findings button.serp-error").first.focus()
            page.keyboard.press("Enter")
            page.wait_for_function("document.activeElement.matches('.cm-content')")
            page.wait_for_selector(".serp-decision.serp-stale")
            page.locator(".cm-content").press("Control+z")
            page.wait_for_selector(".serp-decision:not(.serp-stale)")

            # A fluent that is set, by keyboard, changes the decision's numbers.
            before = page.inner_html(".serp-actions")
            page.locator('.serp-control .q-slider [tabindex="0"]').first.focus()
            for _ in range(20):
                page.keyboard.press("ArrowRight")
            page.wait_for_function(
                "before => document.querySelector('.serp-actions').outerHTML.indexOf(before) < 0",
                arg=before,
            )

            # What is typed is saved.
            page.locator(".cm-content").click()
            page.keyboard.press("Control+Home")
            page.keyboard.type("; mine\n")
            page.keyboard.press("Control+s")
            page.wait_for_selector("text=Saved")
            assert file.read_text()[:7] == "; mine\n"
            assert elsewhere == []
