"""Insertion of comments, effects and processes into the text of a domain file.

All edits are insertions: no byte of the file is removed, and each comment stays behind its effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from serp.diagnosis.repair.formatting import comment
from serp.pddl.edits import Edit, indent_at, line_end, line_start, newline_of
from serp.pddl.sexpr import Group, Word, read_group
from serp.pddl.source import Place, Source

_IMPLYING = {
    ":time": (":time", ":hybrid", ":processes", ":events", ":continuous-effects"),
    ":numeric-fluents": (":numeric-fluents", ":fluents", ":action-costs", ":hybrid"),
}


class InsertionPoints:
    """The text of one domain file.

    Args:
        source: The file; it was parsed without an error.

    Attributes:
        text: All of it.
    """

    def __init__(self, source: Source) -> None:
        self.text = source.text
        self._newline = newline_of(source.text)
        self._top = read_group(source)
        self._groups = [item for item in self._top.items if isinstance(item, Group)]

    def comment_above(self, position: int, text: str) -> Edit:
        """Return the edit that inserts comment lines above the line of a position."""
        start = line_start(self.text, position)
        return Edit(start, start, comment(text, indent_at(self.text, position), self._newline))

    def head(self, title: str, lines: Sequence[str]) -> list[Edit]:
        """Return the edits that put a list at the head of the file, replacing an older one.

        Args:
            title: Its first line; an older list is recognised by the words before the first comma.
            lines: The other lines; empty: no list.
        """
        end, mark = 0, f"; {title.partition(',')[0]}"
        if self.text.startswith(mark):
            end = self.text.find(self._newline * 2) + 2 * len(self._newline)
        written = "".join(comment(f"* {line}", "", self._newline) for line in lines)
        text = f"{comment(title, '', self._newline)}{written}{self._newline}" if lines else ""
        return [Edit(0, end, text)] if text or end else []

    def effects_in(self, schema: Place, effects: Sequence[tuple[str, str]]) -> list[Edit]:
        """Return the edits that give an action further effects.

        Args:
            schema: Where the action is written.
            effects: Each with its evidence, which is inserted above it as a comment.
        """
        group = next(g for g in self._groups if g.place.start == schema.start)
        value = _field(group, ":effect")
        base = indent_at(self.text, (value or group).place.start)
        if value is None:
            at = group.items[-1].place.end
            lines = self._lines(effects, base + "    ")
            return [Edit(at, at, f"{self._newline}{base}  :effect (and{lines})")]
        start, end = value.place.start, value.place.end
        lines = self._lines(effects, base + "  ")
        if not value.items:
            return [Edit(start, end, f"(and{lines})")]
        if value.head != "and":
            before = f"(and{lines}{self._newline}{base}  "
            return [Edit(start, start, before), Edit(end, end, ")")]
        # In front, because comments behind the last effect refer to it.
        at = value.items[0].place.end
        rest = self.text[at : line_end(self.text, at)].strip()
        if not rest or rest.startswith(";"):
            at = line_end(self.text, at)
        elif len(value.items) > 1:  # the text before the first effect ends its indent
            lines += self._newline + (base + "  ")[value.items[1].place.start - at :]
        return [Edit(at, at, lines)]

    def process(self, name: str, parameters: str, effects: Sequence[tuple[str, str]]) -> Edit:
        """Return the edit that adds a process, after the last one or else the last action.

        Args:
            name: Its name.
            parameters: As they are declared: `?r - robot`.
            effects: Each with its evidence.
        """
        anchor = self.last_schema
        base = indent_at(self.text, anchor.start)
        line = self._newline
        text = (
            f"{line}{line}{base}(:process {name}{line}"
            f"{base}  :parameters ({parameters}){line}"
            f"{base}  :precondition (and){line}"
            f"{base}  :effect (and{self._lines(effects, base + '    ')}))"
        )
        rest = self.text[anchor.end : line_end(self.text, anchor.end)].strip()
        at = anchor.end
        if not rest or rest.startswith(";"):
            at = line_end(self.text, anchor.end)
        return Edit(at, at, text)

    @property
    def last_schema(self) -> Place:
        """Place of the last process, or else of the last action."""
        processes = [g.place for g in self._groups if g.head == ":process"]
        return (processes or [g.place for g in self._groups if g.head == ":action"])[-1]

    def requirements(self, needs: Iterable[str]) -> list[Edit]:
        """Return the edits that add missing entries to `:requirements`."""
        section = next((g for g in self._groups if g.head == ":requirements"), None)
        listed = {word.text for word in section.items if isinstance(word, Word)} if section else ()
        missing = [need for need in needs if not set(_IMPLYING[need]) & set(listed)]
        if not missing:
            return []
        if section is not None:
            at = section.items[-1].place.end
            return [Edit(at, at, "".join(f" {need}" for need in missing))]
        at = self._top.items[1].place.end
        words = " ".join([":strips", *missing])
        return [Edit(at, at, f"{self._newline}  (:requirements {words})")]

    def _lines(self, effects: Sequence[tuple[str, str]], indent: str) -> str:
        """Return effects on separate lines, each after a line break."""
        return "".join(
            f"{self._newline}{comment(evidence, indent, self._newline)}{indent}{effect}"
            for evidence, effect in effects
        )


def _field(group: Group, key: str) -> Group | None:
    """Return the group that follows a key of a schema."""
    for word, value in zip(group.items[2::2], group.items[3::2], strict=False):
        if isinstance(word, Word) and word.text == key and isinstance(value, Group):
            return value
    return None
