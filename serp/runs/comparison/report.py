"""The report of a comparison: a self-contained page, its figures and all its numbers."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markdown_it import MarkdownIt

from serp._util.figures import PALETTE, render
from serp._util.files import cannot_write, make_inside, write_durably
from serp._util.terminal import visible
from serp._util.text import code, markdown_text
from serp.runs.comparison import tables
from serp.runs.comparison.charts import Picture, pictures
from serp.runs.comparison.export import comparison_json, episodes_csv, evaluations_csv, measures_csv
from serp.runs.comparison.measures import Results, subject, variant_rows
from serp.runs.comparison.statistics import RESAMPLES
from serp.runs.comparison.tables import NOTHING, number, seeds_text
from serp.runs.summary import WINDOW


def rendered(template: str, **values: Any) -> str:
    """Return a template of `templates/` filled with values; those of `*.html.j2` are escaped."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("serp.runs.comparison"),
        autoescape=select_autoescape(["html.j2"], default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"plain": markdown_text, "code": code, "number": number}
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


_FIGURES: Final = "figures"


def write_report(folder: Path, results: Results) -> None:
    """Write the report of a comparison, finished or not.

    `report.md` and `report.html` (which embeds its figures), `figures/*.png` and `*.svg`,
    `measures.csv`, `episodes.csv`, `evaluations.csv`, `comparison.json`. Equal results give equal
    files on equal machines. Files of an earlier report are replaced.
    """
    drawn = pictures(results)
    markdown = report_text(results, drawn)
    try:
        make_inside(folder, _FIGURES)
    except OSError as error:
        raise cannot_write(folder / _FIGURES, error, "No report was written.") from error
    images = {
        f"{_FIGURES}/{picture.name}.{kind}": render(picture.figure, kind)
        for picture in drawn
        for kind in ("svg", "png")
    }
    files: dict[str, bytes | str] = {
        "report.md": markdown,
        "report.html": html_page(markdown, f"Comparison: {results.plan.task}", images),
        "measures.csv": measures_csv(results),
        "episodes.csv": episodes_csv(results.records),
        "evaluations.csv": evaluations_csv(results.records),
        "comparison.json": comparison_json(results),
        **images,
    }
    for name, content in files.items():
        write_durably(folder / name, content)


def report_text(results: Results, drawn: Sequence[Picture]) -> str:
    """Return the report as Markdown, which names its figures as `figures/<name>.svg`."""
    return rendered(
        "report.md.j2",
        results=results,
        metadata=results.metadata,
        plan=results.plan,
        protocol=results.plan.protocol,
        pictures={picture.name: picture for picture in drawn},
        missing=[*map(str, results.missing)],
        seeds=seeds_text(results.plan.seeds),
        nothing=NOTHING,
        window=WINDOW,
        resamples=RESAMPLES,
        subject=subject(results),
        variants=variant_rows(results),
        tables=tables,
    )
