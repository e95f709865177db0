from __future__ import annotations

import base64
from html.parser import HTMLParser

from serp.comparison.report.rendering import html_page

SVG = b'<svg xmlns="http://www.w3.org/2000/svg"/>'


class Reader(HTMLParser):
    """Every tag and every address of a page."""

    def __init__(self):
        super().__init__()
        self.tags, self.addresses = [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [value for name, value in attrs if name in ("src", "href", "data")]


def read(html):
    reader = Reader()
    reader.feed(html)
    return reader


def test_pictures_are_inside_and_nothing_is_outside():
    html = html_page("# A\n\n![a picture](figures/x.svg)", "A", {"figures/x.svg": SVG})
    (address,) = read(html).addresses
    kind, data = address.split(",")
    assert kind == "data:image/svg+xml;base64"
    assert base64.b64decode(data) == SVG
    assert "default-src 'none'" in html


def test_html_in_a_report_or_title_is_text():
    html = html_page("<script>alert(1)</script> & <b>x</b>", "</title><script>", {})
    assert "script" not in read(html).tags and "b" not in read(html).tags
    assert "&lt;script&gt;" in html


def test_tables_become_tables_that_may_scroll():
    html = html_page("| a | b |\n|---|---:|\n| 1 | 2 |\n", "t", {})
    assert '<div class="wide"><table>' in html and "<td" in html
    assert html.count("<div") == html.count("</div>") == 1
