"""The studio in a real browser: what is typed, clicked and dragged, and who is kept out."""

import socket
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.serp.ui.studio.browser import CHROMIUM, chromium, served
from tests.worlds import DOMAINS

pytest.importorskip("playwright")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")


@dataclass(frozen=True)
class Opened:
    """A file that is open in the studio: its path, the address, the page, and foreign requests."""

    file: Path
    address: str
    page: Any
    elsewhere: list[str]


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studio")
    text = (DOMAINS / "hill.pddl").read_text()
    (folder / "hill.pddl").write_text(text)
    with (
        served("hill.pddl", folder) as address,
        chromium(address, color_scheme="dark") as (page, elsewhere),
    ):
        page.wait_for_selector(".serp-picture img")
        yield Opened(folder / "hill.pddl", address, page, elsewhere)


def test_it_is_served_on_this_machine_alone_and_forgets_its_token(opened):
    origin, _, token = opened.address.partition("/?")
    assert origin.startswith("http://127.0.0.1:") and token.startswith("token=")
    with pytest.raises(OSError):  # another address of this machine
        socket.create_connection(("127.0.0.2", int(origin.rpartition(":")[2])), 1)
    with pytest.raises(urllib.error.HTTPError, match="403"), urllib.request.urlopen(f"{origin}/"):
        pass
    assert "token" not in opened.page.url
    cookies = {each["name"]: each["value"] for each in opened.page.context.cookies(opened.page.url)}
    assert cookies and not opened.page.context.cookies(origin)  # nor for another port
    used = urllib.request.Request(opened.address)
    with pytest.raises(urllib.error.HTTPError, match="403"), urllib.request.urlopen(used):
        pass
    # A page that nobody connects with takes nothing over.
    own = "; ".join(f"{name}={value}" for name, value in cookies.items())
    asked = urllib.request.Request(opened.page.url, headers={"cookie": own})
    with urllib.request.urlopen(asked) as answer:
        assert answer.status == 200
    opened.page.wait_for_timeout(500)
    assert opened.page.locator(".serp-elsewhere").count() == 0


def test_the_page_follows_what_is_typed_and_set(opened):
    page = opened.page
    page.wait_for_selector("body.body--dark")

    # A mistake is underlined, listed with its place, and leads there.
    page.locator(".cm-content:visible").click()
    page.keyboard.press("Control+End")
    page.keyboard.type("oops")
    page.wait_for_selector(".serp-mark-error:has-text('oops')")
    page.locator(".serp-findings button.serp-error").first.focus()
    page.keyboard.press("Enter")
    page.wait_for_function("document.activeElement.matches('.cm-content')")
    page.wait_for_selector(".serp-decision.serp-stale")
    page.locator(".cm-content:visible").press("Control+z")
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


def test_what_is_typed_is_saved_whatever_comes_from_the_server_meanwhile(opened):
    page, words = opened.page, [f"word{k}," for k in range(8)]
    text = opened.file.read_text()
    page.locator(".cm-content:visible").click()
    page.keyboard.press("Control+Home")
    page.keyboard.type("; ")
    for word in words:  # without waiting
        page.evaluate("document.querySelector('.serp-head button:last-of-type').click()")
        page.keyboard.type(word)
    page.keyboard.press("Enter")
    page.keyboard.press("Control+s")
    typed = f"; {''.join(words)}\n{text}"
    for _ in range(200):
        if opened.file.read_text() == typed:
            break
        page.wait_for_timeout(50)
    assert opened.file.read_text() == typed
    assert opened.elsewhere == []
