"""The codes of findings, as docs/reference/checks.md has them."""

import re
from pathlib import Path

TEXT = (Path(__file__).resolve().parents[4] / "docs" / "reference" / "checks.md").read_text()
_ROW = re.compile(r"^\| `([\w-]+)` \| (?:.*?) \| (?:`(.*?)`)? \|$", re.MULTILINE)
EXAMPLES = dict(_ROW.findall(TEXT))
"""Code → example; empty where there is none."""
ERRORS = dict(_ROW.findall(TEXT.partition("## Warnings")[0])).keys()
