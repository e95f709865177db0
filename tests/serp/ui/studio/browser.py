"""A studio in a process of its own, and a headless Chromium that shows it."""

import contextlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")


@contextlib.contextmanager
def served(file, folder):
    """Serve a file from a folder; yield the address with its token."""
    root = Path(__file__).resolve().parents[4]
    paths = os.pathsep.join(str(root / part) for part in ("", "adapters", "envs"))
    process = subprocess.Popen(
        [sys.executable, "-m", "serp", "studio", file, "--no-browser"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    try:
        yield process.stdout.readline().strip()
    finally:
        process.terminate()
        process.communicate(timeout=20)


@contextlib.contextmanager
def chromium(address, ready=".serp-graph svg", **options):
    """Open an address; yield the page, and what it asks for elsewhere or complains of."""
    from playwright.sync_api import sync_playwright

    origin = address.partition("/?")[0]
    elsewhere = []

    def note(request):
        if not request.url.startswith((origin, "data:", "blob:")):
            elsewhere.append(request.url)

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1500, "height": 950}, **options)
        page.set_default_timeout(30_000)
        page.on("request", note)
        page.on("pageerror", lambda error: elsewhere.append(str(error)))
        page.goto(address)
        page.wait_for_selector(ready)
        yield page, elsewhere
        browser.close()
