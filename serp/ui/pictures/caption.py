"""The caption below the pictures of an episode: actor, action, and vetoes with their reasons."""

from __future__ import annotations

from pathlib import Path
from typing import Final, NamedTuple

import matplotlib
from PIL import Image, ImageDraw, ImageFont

from serp._util.figures import ACTORS, REFUSED
from serp.agent.decision import Actor

BACKGROUND: Final = "#16191F"
INK: Final = "#F2F4F7"
_SMALLEST, _LARGEST = 12, 26


class Mark(NamedTuple):
    """An event that is marked red, a veto or an unsafe action, and its reason by the file."""

    what: str
    why: str


class Caption(NamedTuple):
    """The content of a caption.

    Attributes:
        actor: Who acts; None before the first decision.
        action: Name of the action.
        facts: Episode, step, return; if there is little room, the first ones are left out.
        marks: Texts marked red.
        outcome: How the episode ended; empty while it runs, or if the environment does not say.
    """

    actor: Actor | None
    action: str
    facts: tuple[str, ...]
    marks: tuple[Mark, ...] = ()
    outcome: str = ""


class CaptionBand:
    """Draws captions of one width; all have the same `size`, pixels."""

    def __init__(self, width: int) -> None:
        letters = min(max(width // 44, _SMALLEST), _LARGEST)
        fonts = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
        self._plain = ImageFont.truetype(fonts / "DejaVuSans.ttf", letters)
        self._bold = ImageFont.truetype(fonts / "DejaVuSans-Bold.ttf", letters)
        self._pad = letters // 2
        self._line = round(1.5 * letters)
        height = 3 * (self._pad + self._line)
        self.size = (width, height + height % 2)  # videos want even numbers

    def draw(self, caption: Caption) -> Image.Image:
        """Return the band of a caption, RGB."""
        image = Image.new("RGB", self.size, BACKGROUND)
        draw = ImageDraw.Draw(image)
        self._draw_decision(draw, caption)
        if caption.marks:
            self._draw_marks(draw, caption.marks)
        return image

    def _draw_decision(self, draw: ImageDraw.ImageDraw, caption: Caption) -> None:
        gap = "   "
        width, pad = self.size[0], self._pad
        middle = pad + self._line // 2
        left, right = pad, width - pad
        if (actor := caption.actor) is not None:
            ink = BACKGROUND if actor in (Actor.LEARNER, Actor.FALLBACK) else INK
            left = self._draw_label(draw, left, actor.value.upper(), ACTORS[actor], ink)
        if caption.outcome:
            word = _cut(self._bold, caption.outcome.upper(), width // 3)
            right -= round(self._bold.getlength(word)) + 2 * pad
            self._draw_label(draw, right, word, INK, BACKGROUND)
            right -= pad
        # If there is little room, the action comes before the facts.
        action = _cut(self._bold, caption.action, right - left)
        draw.text((left, middle), action, fill=INK, font=self._bold, anchor="lm")
        room = right - left - self._bold.getlength(action) - 2 * pad
        facts = list(caption.facts)
        while facts and self._plain.getlength(gap.join(facts)) > room:
            del facts[0]
        draw.text((right, middle), gap.join(facts), fill="#A9B0BB", font=self._plain, anchor="rm")

    def _draw_label(
        self, draw: ImageDraw.ImageDraw, left: int, word: str, colour: str, ink: str
    ) -> int:
        """Write a word on a coloured background; return the position to its right."""
        pad = self._pad
        end = left + self._bold.getlength(word) + 2 * pad
        draw.rounded_rectangle((left, pad, end, pad + self._line - 2), pad // 2, fill=colour)
        draw.text((left + pad, pad + self._line // 2), word, fill=ink, font=self._bold, anchor="lm")
        return round(end) + pad

    def _draw_marks(self, draw: ImageDraw.ImageDraw, marks: tuple[Mark, ...]) -> None:
        width, height = self.size
        pad = self._pad
        top = height - 2 * self._line - pad // 2
        draw.rectangle((0, top - pad // 2, width, height), fill=REFUSED)
        # A single reason has a line of its own.
        lines = [(marks[0].what, ""), ("", marks[0].why)] if len(marks) == 1 else marks[:2]
        for number, (what, why) in enumerate(lines):
            left, middle = pad, top + number * self._line + self._line // 2
            for text, font in ((what, self._bold), (why, self._plain)):
                shown = _cut(font, text, width - pad - left)
                draw.text((left, middle), shown, fill=INK, font=font, anchor="lm")
                left += round(font.getlength(shown)) + 2 * pad if shown else 0


def _cut(font: ImageFont.FreeTypeFont, text: str, room: float) -> str:
    """Return a text, cut to the available width."""
    if font.getlength(text) <= room:
        return text
    while text and font.getlength(text + "…") > room:
        text = text[:-1]
    return text and text + "…"
