"""A file in the editor: its text, what is on the disk, and saving it within the working folder."""

from __future__ import annotations

import os
from pathlib import Path

from serp._util.files import write_durably
from serp.errors import SerpError
from serp.pddl.source import Source, newline_of


class Document:
    """A text that is edited, and the file that it came from.

    Lines end with a line feed while they are edited; the file keeps its own line ends. It is saved
    as `target`: the file itself where that is in `folder`, or else the same name, or `name`, in
    `folder`. `saved` is the text as it was read or last written.
    """

    def __init__(self, path: Path, folder: Path, name: str | None = None) -> None:
        self.path = path
        self._folder = folder.resolve()
        inside = name is None and self._inside(path)
        self.target = path if inside else self._folder / (name or path.name)
        self._newline = "\n"
        self._known: str | None = None  # the file at `target` as far as it is known
        self.text = self.saved = ""
        if path.exists():
            self.reload()

    def reload(self) -> None:
        """Take the text that is on the disk."""
        text = Source.read(self.path).text
        self._known = None if self.elsewhere else text
        self._newline = newline_of(text)
        self.text = self.saved = text.replace("\r\n", "\n").replace("\r", "\n")

    def _inside(self, path: Path) -> bool:
        return path.resolve().is_relative_to(self._folder)

    @property
    def elsewhere(self) -> bool:
        """Whether it still is the file outside of the folder, and saving it moves it."""
        return self.path != self.target

    @property
    def changed(self) -> bool:
        """Whether the text differs from what was read or last written."""
        return self.text != self.saved

    def save(self) -> Path:
        """Write the text to `target` atomically, and return that.

        A file that another program has changed is replaced the second time only.
        """
        there = Source.read(self.target).text if self.target.exists() else None
        if there != self._known:
            self._known = there
            raise SerpError(
                f"{self.target} was changed by another program since it was read; save again to "
                "replace it"
            )
        self._known = self._write(self.target)
        self.saved, self.path = self.text, self.target
        return self.target

    def keep(self) -> str:
        """Write the text to a new file beside `target`; return where it is, or why it is not."""
        name = self.target.name + ".unsaved"
        aside, number = self.target.with_name(name), 1
        while os.path.lexists(aside):  # what an earlier session kept
            number += 1
            aside = self.target.with_name(f"{name}-{number}")
        try:
            self._write(aside)
        except SerpError as error:
            return f"The unsaved text of {self.path} is lost: {error}"
        return f"The unsaved text is kept in {aside}"

    def _write(self, path: Path) -> str:
        if not self._inside(path):  # a link may have been put there
            raise SerpError(f"{path} leads out of the working folder {self._folder}")
        text = self.text.replace("\n", self._newline)
        content = text.encode(errors="replace")
        write_durably(path, content)
        return content.decode()
