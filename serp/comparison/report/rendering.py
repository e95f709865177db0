"""The report's Jinja2 templates filled with values, and Markdown as one HTML page."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markdown_it import MarkdownIt

from serp._util.figures import PALETTE
from serp._util.markdown import code, plain
from serp._util.terminal import visible
from serp.comparison.report.formatting import number


def rendered(template: str, **values: Any) -> str:
    """Return a template of `templates/` filled with values; those of `*.html.j2` are escaped."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("serp.comparison.report"),
        autoescape=select_autoescape(["html.j2"], default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"plain": plain, "code": code, "number": number}
    return environment


def html_page(markdown: str, title: str, pictures: Mapping[str, bytes]) -> str:
    """Return Markdown as an HTML document; it embeds `pictures` (address → SVG), HTML is shown."""
    reader = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = reader.parse(markdown)
    for token in tokens:
        for part in token.children or ():
            source = str(part.attrGet("src") or "")
            if part.type == "image" and source in pictures:
                embedded = b64encode(pictures[source]).decode("ascii")
                part.attrSet("src", f"data:image/svg+xml;base64,{embedded}")
    body = reader.renderer.render(tokens, reader.options, {})
    body = body.replace("<table>", '<div class="wide"><table>')
    body = body.replace("</table>", "</table></div>")
    return rendered("page.html.j2", title=visible(title), body=body, palette=PALETTE)
