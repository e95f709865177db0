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

from serp.report.report import write_report
from serp.training.run import load_run
from tests.serp.studio.browser import chromium


def main() -> None:
    """Write the report, go to a veto in the last episodes, and take the picture."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.html"
        write_report(load_run(sys.argv[1]), file, pictures=400, baseline=0)
        with chromium(file.as_uri(), "html[data-ready=true]") as (page, _):
            page.evaluate("document.querySelector('#steps').scrollIntoView()")
            page.keyboard.press("Shift+ArrowLeft")
            page.keyboard.press("End")
            page.wait_for_timeout(500)
            picture = Image.open(io.BytesIO(page.screenshot()))
    picture.quantize(128).save(sys.argv[2], optimize=True)


if __name__ == "__main__":
    main()
