"""Makes the picture of the studio: `python -m docs.drawings.studio FILE.png`, from the checkout.

It needs playwright and Chromium.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image

from tests.serp.ui.studio.browser import chromium, served


def main() -> None:
    """Serve soccer, wait until an episode has been played, and take the picture."""
    with served("soccer", Path.cwd()) as address, chromium(address) as (page, _):
        page.wait_for_selector(".serp-picture img")
        page.wait_for_timeout(2_000)
        picture = Image.open(io.BytesIO(page.screenshot()))
    picture.quantize(128).save(sys.argv[1], optimize=True)


if __name__ == "__main__":
    main()
