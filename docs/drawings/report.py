"""Makes the picture of a report: `python -m docs.drawings.report RUN FILE.png`, from the checkout.

RUN is a run of soccer, such as `serp plan-and-learn --domain soccer --preset paper` makes. It needs
playwright and Chromium.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image

from serp.runs.run import load_run
from serp.ui.report.report import write_report
from tests.serp.ui.studio.browser import chromium

_LAST_DRAWN = 1100
"""An episode among the last ones, which are drawn."""


def main() -> None:
    """Write the report, go to one of the most frequent vetoes, and take the picture."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        write_report(load_run(sys.argv[1]), file, evaluation=None, steps=30_000, pictures=4_000)
        with chromium(file.as_uri(), "html[data-ready=true]") as (page, _):
            page.click("#refused .cards button[data-card] >> nth=0")
            page.wait_for_timeout(1_500)  # until the page has scrolled there
            page.fill("#episode", str(_LAST_DRAWN))
            page.press("#episode", "Enter")
            page.click("#next-hit")
            page.wait_for_timeout(300)
            page.click("#causes .reward button.line >> nth=0")
            page.evaluate("document.activeElement.blur()")
            page.wait_for_timeout(500)
            picture = Image.open(io.BytesIO(page.screenshot()))
    picture.quantize(128).save(sys.argv[2], optimize=True)


if __name__ == "__main__":
    main()
