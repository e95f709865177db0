"""The picture of a decision as a file: the planning graph with what there is to say of it.

The file is SVG with text as text, which can be searched and read aloud. It is light or dark as the
reader's other pages are.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Final

from serp._util.figures import colour, style_sheet
from serp._util.number_format import readable
from serp.explanation.sentences import kind_of_return, special_about
from serp.planning.limits import Bound
from serp.viz.plan_svg import CHARACTER, DASHES, ENDS, HARMS, SIZE, PlanPicture, draw_plan, end_mark

if TYPE_CHECKING:
    from serp.planning.replanner import MonitorReplanner, Plan

_NARROWEST: Final = 560.0
_LINE: Final = 19.0
_EDGE: Final = 16.0  # around everything
_SAMPLE: Final = 40.0  # of a line in the legend


def plan_picture(plan: Plan, planner: MonitorReplanner, *, title: str = "Planning graph") -> bytes:
    """Return the picture of a decision as the content of an SVG file.

    A large graph is drawn in part (`serp.viz.plan_layout.MAX_ROWS`): the best path, and layer by
    layer what follows the best states; the rest is counted. Equal decisions give equal bytes.

    Args:
        plan: The decision.
        planner: The planner of the decision.
        title: Title of the picture.
    """
    picture = draw_plan(plan, planner)
    width = max(_NARROWEST, picture.width)
    wide = int(width / CHARACTER)
    y = _LINE
    lines = [_text(0, y, title, "ink", f' font-weight="600" font-size="{SIZE + 4}"')]
    for text in _head(plan, planner, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    y += _LINE / 2
    lines += [f'<g transform="translate(0 {y:.1f})">', *picture.lines, "</g>"]
    y += picture.height
    x = 0.0
    for sample, text in _legend(picture, plan):
        if x and x + _SAMPLE + CHARACTER * len(text) > width:
            x, y = 0.0, y + _LINE
        lines += [f'<g transform="translate({x:.1f} {y:.1f})">{sample}</g>',
                  _text(x + _SAMPLE, y + 4.5, text)]  # fmt: skip
        x += _SAMPLE + CHARACTER * (len(text) + 2)
    y += _LINE / 2
    for text in _foot(picture, plan, planner, wide):
        y += _LINE
        lines.append(_text(0, y, text))
    all_wide, all_high = width + 2 * _EDGE, y + 2 * _EDGE
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{all_wide:.0f}" '
            f'height="{all_high:.0f}" viewBox="0 0 {all_wide:.0f} {all_high:.0f}" role="img" '
            f'font-family="system-ui, sans-serif" font-size="{SIZE}">',
            style_sheet(),
            f"<title>{escape(title)}</title>",
            f'<rect width="100%" height="100%" style="fill:{colour("surface")}"/>',
            f'<g transform="translate({_EDGE:.0f} {_EDGE / 2:.0f})">',
            *lines,
            "</g></svg>\n",
        ]
    ).encode()


def _text(x: float, y: float, text: str, shade: str = "faint", more: str = "") -> str:
    style = f'style="fill:{colour(shade)}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{more} {style}>{escape(text)}</text>'


def _head(plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    state, fluents = plan.graph.nodes[0]["state"], planner.model.fluents
    numbers = [f"{f.name} = {readable(float(state[f.index]))}" for f in fluents if f.numeric]
    facts = [f.name for f in fluents if not f.numeric and state[f.index]]
    lines = _wrapped("State: ", ", ".join(numbers + facts), wide, 3)
    if plan.name is None:
        return [*lines, "No action is applicable."]
    return lines + _wrapped("Best path: ", " → ".join(step.action for step in plan.path), wide, 2)


def _foot(picture: PlanPicture, plan: Plan, planner: MonitorReplanner, wide: int) -> list[str]:
    settings, layout = planner.settings, picture.layout
    sentences = []
    if plan.name is not None:
        actions = f"{plan.depth} action{'' if plan.depth == 1 else 's'}"
        if settings.repeat > 1:
            actions += f", each repeated for {settings.repeat} control periods"
        ended = ", ended by the limit on nodes" if plan.bound is Bound.NODES else ""
        sentences.append(f"Lookahead: {actions}; discount {settings.discount:g}{ended}.")
    if plan.path:
        kind = kind_of_return(plan.bound.partial)
        sentences.append(f"A number beside a first action is its {kind}.")
    sentences += special_about(plan.forecast)
    edges = plan.graph.number_of_edges()
    if len(layout.branches) < edges:
        sentences.append(
            f"Drawn are {len(layout.branches):,} of {edges:,} edges: the best path, and layer by "
            "layer what follows the best states."
        )
    names = [a.name for a, ok in zip(planner.model.actions, plan.forecast.applicable, strict=True)
             if not ok]  # fmt: skip
    return [
        *textwrap.wrap(" ".join(sentences), wide),
        *_wrapped("Not applicable here: ", ", ".join(names), wide, 2),
    ]


def _wrapped(before: str, text: str, wide: int, most: int) -> list[str]:
    """Return a text in at most `most` lines; none if it is empty."""
    return textwrap.wrap(before + text, wide, max_lines=most, placeholder=" …") if text else []


def _legend(picture: PlanPicture, plan: Plan) -> Iterator[tuple[str, str]]:
    """Yield a sample and a text for each style that occurs."""
    branches = picture.layout.branches
    if plan.path:
        yield _line("good" if plan.safe else "bad", 3.4), "best path"
    clear = [branch for branch in branches if not (branch.harm or branch.muted)]
    for name, shade, thick, high in (("high", "good", 1.8, True), ("low", "bad", 1.1, False)):
        totals = [branch.total for branch in clear if (branch.value >= 0.5) == high]
        if totals:
            low, best = readable(min(totals)), readable(max(totals))
            yield (
                _line(shade, thick, 0.75),
                f"{name}: return {low if low == best else f'{low} to {best}'}",
            )
    harms = {branch.harm for branch in branches if not branch.muted}
    for harm, text in HARMS.items():
        if harm in harms:
            yield _line("bad", 1.2, dashes=DASHES[harm]), text
    if any(branch.muted and not branch.chosen for branch in branches):
        yield _line("faint", 1.2), "behind a harm"
    ends = {branch.end for branch in branches if branch.harm != "unsafe"}
    for end, text in ENDS.items():
        if end in ends:
            yield end_mark(end, _SAMPLE - 12, 0), text


def _line(shade: str, thick: float, opacity: float = 1.0, dashes: str = "") -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    return (
        f'<path d="M0 0H{_SAMPLE - 8:.0f}" fill="none" stroke-width="{thick}" opacity="{opacity}"'
        f'{dashed} style="stroke:{colour(shade)}"/>'
    )
