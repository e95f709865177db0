"""Draw the two diagrams of the documentation: the way of a step, and the way of a line of PDDL.

    python docs/drawings/diagrams.py docs/images

They are light or dark as the reader's pages are, on a background of their own.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from html import escape
from pathlib import Path

from serp._util.figures import PALETTE, colour, style_sheet

TINTS = {"before": ("#dbeafe", "#1d3350"), "after": ("#dcfce7", "#17382a")}
"""Filling of a box, on light and on dark."""
BOX, HEIGHT = 150, 64
HEAD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" \
font-family="Helvetica, Arial, sans-serif" font-size="13" style="fill:{ink}">
{sheet}<style>rect.before{{fill:{before[0]}}} rect.after{{fill:{after[0]}}}
@media (prefers-color-scheme: dark){{rect.before{{fill:{before[1]}}} \
rect.after{{fill:{after[1]}}}}}</style>
<title>{title}</title>
<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" \
orient="auto"><path d="M0 0L8 4L0 8z" style="fill:{faint}"/></marker></defs>
<rect width="{width}" height="{height}" rx="10" style="fill:{surface}"/>
"""


def head(width: int, height: int, title: str) -> str:
    """Return the beginning of a file."""
    colours = {name: colour(name) for name in PALETTE}
    return HEAD.format(
        width=width, height=height, title=title, sheet=style_sheet(), **colours, **TINTS
    )


def text(x: float, y: float, words: str, style: str = "") -> str:
    """Return centred text."""
    return f'<text x="{x}" y="{y}" text-anchor="middle" {style}>{escape(words)}</text>\n'


def box(x: float, y: float, title: str, below: str, tint: str = "before") -> str:
    """Return a box with a title and a line in small letters."""
    return (
        f'<rect class="{tint}" x="{x}" y="{y}" width="{BOX}" height="{HEIGHT}" rx="8" '
        f'style="stroke:{colour("faint")}"/>\n'
        + text(x + BOX / 2, y + 28, title, 'font-weight="bold"')
        + text(x + BOX / 2, y + 48, below, 'font-size="11" font-family="monospace"')
    )


def arrow(*points: tuple[float, float], dashed: bool = False) -> str:
    """Return an arrow along some points."""
    path = "L".join(f"{x} {y}" for x, y in points)
    dashes = ' stroke-dasharray="5 4"' if dashed else ""
    style = f'fill="none" style="stroke:{colour("faint")}"{dashes}'
    return f'<path d="M{path}" {style} marker-end="url(#tip)"/>\n'


def label(x: float, y: float, words: str) -> str:
    """Return the name of what goes along an arrow."""
    return text(x, y, words, 'font-size="12" font-style="italic"')


def step() -> str:
    """Return the drawing of one step."""
    columns = [20 + 220 * i for i in range(5)]
    up, down = 30, 200
    middle = [x + BOX / 2 for x in columns]
    parts = [head(1070, 340, "The way of a step")]
    for x, title, below in zip(
        columns,
        ("environment", "grounding", "planner", "strategy", "arbiter, vetoes"),
        ("gymnasium.Env", "serp.tasks", "serp.planning", "serp.agent", "serp.agent"),
        strict=True,
    ):
        parts.append(box(x, up, title, below))
    for i, words in enumerate(("observation", "state", "forecast", "proposal")):
        parts.append(arrow((columns[i] + BOX, up + 32), (columns[i + 1], up + 32)))
        parts.append(label(columns[i] + BOX + 35, up + 22, words))
    for x, title, below in zip(
        columns,
        ("run folder", "replay, learner", "model adaptation", "step record", "environment"),
        ("serp.runs", "serp.learning", "model.learned", "serp.agent", "gymnasium.Env"),
        strict=True,
    ):
        parts.append(box(x, down, title, below, "after"))
    parts.append(arrow((middle[4], up + HEIGHT), (middle[4], down)))
    parts.append(label(middle[4] - 35, 160, "decision"))
    parts.append(arrow((columns[4], down + 32), (columns[3] + BOX, down + 32)))
    parts.append(label(columns[4] - 35, down + 22, "transition"))
    for i in (2, 1, 0):
        points = ((middle[3], down + HEIGHT), (middle[3], 310), (middle[i], 310))
        parts.append(arrow(*points, (middle[i], down + HEIGHT)))
    parts.append(arrow((middle[2], down), (middle[2], up + HEIGHT), dashed=True))
    parts.append(label(middle[2] + 58, 182, "adapted model"))
    parts.append(
        arrow(
            (middle[1], down),
            (middle[1], 140),
            (middle[3], 140),
            (middle[3], up + HEIGHT),
            dashed=True,
        )
    )
    parts.append(label(middle[1] + 40, 132, "Q-values"))
    return "".join(parts) + "</svg>\n"


def chain(y: float, boxes: Sequence[tuple[str, str]], tint: str) -> str:
    """Return boxes in a row, joined by arrows."""
    parts = []
    for i, (title, below) in enumerate(boxes):
        x = 20 + 200 * i
        parts.append(box(x, y, title, below, tint))
        if i:
            parts.append(arrow((x - 50, y + 32), (x, y + 32)))
    return "".join(parts)


def line() -> str:
    """Return the drawing of how a line of a file becomes a prediction."""
    parts = [head(990, 310, "The way of a line of PDDL")]
    parts.append(
        text(
            250,
            34,
            "(increase (pole-velocity) (* #t (* 15.8 (pole-angle))))",
            'font-family="monospace"',
        )
    )
    parts.append(arrow((95, 40), (95, 60)))
    parts.append(
        chain(
            60,
            (
                ("nested lists", "serp.pddl.reader"),
                ("syntax", "pddl.parser"),
                ("ground model", "model.grounder"),
                ("instructions", "model.instructions"),
                ("step", "serp._core"),
            ),
            "before",
        )
    )
    for x, words in ((170, "places"), (370, "types"), (570, "objects"), (770, "indices, θ")):
        parts.append(label(x + 25, 145, words))
    parts.append(arrow((895, 124), (895, 184), (495, 184), (495, 204)))
    parts.append(label(700, 177, "(state, action, θ, Δt) → next state, reward, flags"))
    for x, title, below in (
        (220, "lookahead", "serp.planning"),
        (420, "veto, explanation", "serp.agent"),
        (620, "diagnosis, repair", "runs.diagnosis"),
    ):
        parts.append(box(x, 220, title, below, "after"))
    parts.append(arrow((495, 204), (295, 204), (295, 220)))
    parts.append(arrow((495, 204), (495, 220)))
    parts.append(arrow((495, 204), (695, 204), (695, 220)))
    parts.append(arrow((770, 252), (940, 252), (940, 124), dashed=True))
    parts.append(label(856, 245, "new θ, new effects"))
    return "".join(parts) + "</svg>\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    (folder / "step.svg").write_text(step(), encoding="utf-8")
    (folder / "line.svg").write_text(line(), encoding="utf-8")
