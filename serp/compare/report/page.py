"""A Markdown report as one HTML page that needs nothing beside it."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from html import escape
from typing import Final

from markdown_it import MarkdownIt

from serp._util.terminal import visible

_CSS: Final = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #fff;
  max-width: 62rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.8rem; line-height: 1.2; }
h2 { font-size: 1.3rem; margin-top: 2.6rem; border-bottom: 1px solid #e4e7eb;
  padding-bottom: .25rem; }
h3 { font-size: 1.05rem; margin-top: 1.8rem; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .85rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .65rem; border-bottom: 1px solid #e4e7eb; vertical-align: top;
  text-align: left; }
th { border-bottom: 2px solid #8a8f98; vertical-align: bottom; }
tbody tr:hover { background: #f6f7f9; }
img { display: block; max-width: 100%; height: auto; margin: 1.2rem 0 .4rem; }
pre { background: #f6f7f9; padding: .8rem 1rem; overflow-x: auto; border-radius: 4px; }
code { font: .88em ui-monospace, "DejaVu Sans Mono", monospace; }
"""

_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"


def page(markdown: str, title: str, pictures: Mapping[str, bytes]) -> str:
    """Make an HTML page of a report.

    Args:
        markdown: The report. HTML in it is shown as text.
        title: Of the page; any text.
        pictures: Address of a picture in the report → the SVG file, which the page will hold.

    Returns:
        A whole document. It refers to nothing outside, and asks the browser to load nothing.
    """
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(markdown)
    for token in tokens:
        for part in token.children or ():
            source = str(part.attrGet("src") or "")
            if part.type == "image" and source in pictures:
                held = b64encode(pictures[source]).decode("ascii")
                part.attrSet("src", f"data:image/svg+xml;base64,{held}")
    body = reader.renderer.render(tokens, reader.options, {})
    body = body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(visible(title))}</title>\n<style>{_CSS}</style>\n</head>\n<body>\n"
        f"{body}</body>\n</html>\n"
    )
