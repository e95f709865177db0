"""The page of a run in a headless Chromium: its size, first paint, and frames while scrubbing.

    python tests/benchmarks/bench_report.py RUN|FILE.html [--pictures N] [--frames N]

A finger drags over the timeline, a move a frame, at three speeds. Printed are the time between
frames (median and 95 % quantile, ms; 16.7 is 60 frames a second) and what the page itself needs for
one: script, style and layout.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from pathlib import Path

from serp.runs.run import load_run
from serp.ui.report.report import PICTURES, write_report

_DRAG = """async ([speed, frames]) => {
  const strip = document.querySelector('#run-strip'), box = strip.getBoundingClientRect();
  strip.setPointerCapture = () => {};
  const send = (type, x) => strip.dispatchEvent(
    new PointerEvent(type, { clientX: x, clientY: box.top + 5, buttons: 1, bubbles: true }));
  const gaps = [];
  let last = await new Promise(requestAnimationFrame);
  for (let k = 0; k < frames; k++) {
    send(k ? 'pointermove' : 'pointerdown', box.left + (k * speed) % box.width);
    const now = await new Promise(requestAnimationFrame);
    gaps.push(now - last);
    last = now;
  }
  gaps.sort((a, b) => a - b);
  return [gaps[gaps.length >> 1], gaps[Math.floor(0.95 * gaps.length)]];
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--pictures", type=int, default=PICTURES)
    parser.add_argument("--frames", type=int, default=600)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        file = given.run
        if file.is_dir():
            file, begin = Path(folder) / "report.html", time.perf_counter()
            write_report(load_run(given.run), file, pictures=given.pictures)
            print(f"written in {time.perf_counter() - begin:.0f} s")
        print(f"{file.stat().st_size / 1e6:.2f} MB")
        measure(file.resolve(), given.frames)


def measure(file: Path, frames: int) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        begin = time.perf_counter()
        page.goto(file.as_uri())
        page.wait_for_selector("html[data-ready=true]")
        print(f"ready after {time.perf_counter() - begin:.2f} s")
        paints = page.evaluate(
            "performance.getEntriesByType('paint').map((each) => [each.name, each.startTime])"
        )
        print(", ".join(f"{name} {at:.0f} ms" for name, at in paints))
        page.evaluate("document.querySelector('#steps').scrollIntoView()")
        probe = page.context.new_cdp_session(page)
        probe.send("Performance.enable")
        for speed in (0.1, 0.7, 4.0):
            before = {
                m["name"]: m["value"] for m in probe.send("Performance.getMetrics")["metrics"]
            }
            median, tail = page.evaluate(_DRAG, [speed, frames])
            after = {m["name"]: m["value"] for m in probe.send("Performance.getMetrics")["metrics"]}
            own = {
                what: 1e3 * (after[f"{what}Duration"] - before[f"{what}Duration"]) / frames
                for what in ("Script", "RecalcStyle", "Layout")
            }
            parts = ", ".join(f"{what} {spent:.1f}" for what, spent in own.items())
            print(f"{speed} px a frame: {median:.1f} ms, {tail:.1f} ms; of these {parts}")
        browser.close()


if __name__ == "__main__":
    main()
