"""A file in the editor: its text, what is on the disk, and saving it within the working folder."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

from serp._util.files import write_durably
from serp.errors import SerpError
from serp.model.domain import problem_beside
from serp.pddl.source import Source

_MARK = "\ufeff"


class ChangedOnDisk(SerpError):
    """A file that is to be saved has been changed, made or removed by somebody else."""


class Document:
    """A text that is edited, and the file that it came from.

    Lines end with a line feed while they are edited; the file keeps its own line ends, and its byte
    order mark.

    Args:
        path: The file; it need not exist.
        folder: Files are written in this folder alone. A document from elsewhere is saved in it
            under the same name.
        name: Name in `folder`, or path, under which it is saved, where the file itself must stay
            as it is.

    Raises:
        DomainError: The file exists and cannot be read.

    Attributes:
        text: The text as it is edited.
        saved: The text as it was read or last written.
        target: Where it is saved.
    """

    def __init__(self, path: Path, folder: Path, name: str | None = None) -> None:
        self.path = path
        self._folder = folder.resolve()
        inside = name is None and self._inside(path)
        self.target = path if inside else self._folder / (name or path.name)
        self._newline, self._mark = "\n", ""
        self._digest: bytes | None = None
        self.text = self.saved = ""
        if path.exists():
            self._read(path)
        if self.target != path:
            self._digest = None  # it is not there, as far as is known

    def _read(self, path: Path) -> None:
        text = Source.read(path).text
        content = path.read_bytes()
        self._digest = _digest(content)
        self._mark = _MARK if content.startswith(_MARK.encode()) else ""
        self._newline = "\r\n" if "\r\n" in text else "\n"
        self.text = self.saved = text.replace("\r\n", "\n").replace("\r", "\n")

    def _inside(self, path: Path) -> bool:
        return path.resolve().is_relative_to(self._folder)

    @property
    def name(self) -> str:
        """The file as messages call it."""
        return str(self.path)

    @property
    def elsewhere(self) -> bool:
        """Whether it still is the file outside of the folder, and saving it moves it."""
        return self.path != self.target

    @property
    def changed(self) -> bool:
        """Whether the text differs from what was read or last written."""
        return self.text != self.saved

    @property
    def outdated(self) -> bool:
        """Whether the file on the disk is not the one that was read or last written.

        Raises:
            SerpError: It cannot be read.
        """
        return self._on_disk() != self._digest

    def save(self, *, anyway: bool = False) -> Path:
        """Write the text to `target` atomically, and return that.

        Args:
            anyway: Whether to replace what somebody else has written there.

        Raises:
            ChangedOnDisk: The file there is not the one that was read or last written.
            RunError: It cannot be written.
        """
        if not anyway and self.outdated:
            raise ChangedOnDisk(f"{self.target} was changed by another program since it was read")
        content = self._write(self.target)
        self._digest, self.saved, self.path = _digest(content), self.text, self.target
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
            return f"What was not saved of {self.name} is lost: {error}"
        return f"What was not saved is in {aside}"

    def _write(self, path: Path) -> bytes:
        if not self._inside(path):  # a link may have been put there
            raise SerpError(f"{path} leads out of the working folder {self._folder}")
        content = (self._mark + self.text.replace("\n", self._newline)).encode()
        write_durably(path, content)
        return content

    def reload(self) -> None:
        """Take the text that is on the disk.

        Raises:
            DomainError: It cannot be read.
        """
        self._read(self.target if self.target.exists() else self.path)

    def _on_disk(self) -> bytes | None:
        try:
            return _digest(self.target.read_bytes())
        except FileNotFoundError:
            return None
        except OSError as error:
            raise SerpError(f"{self.target}: {error.strerror}") from error


def save_together(domain: Document, problem: Document | None, *, anyway: bool) -> list[Path]:
    """Save a domain and its problem where they were changed; return their files.

    They move into the working folder together: commands look for the problem beside the domain.
    """
    both = [domain] if problem is None else [domain, problem]
    moving = any(each.changed for each in both) or read_instead(domain, problem) is not None
    changed = [each for each in both if each.changed or (moving and each.elsewhere)]
    return [each.save(anyway=anyway) for each in changed]


def read_instead(domain: Document, problem: Document | None) -> Path | None:
    """Return where commands look for the problem of a domain, if it is not this one."""
    beside = problem_beside(domain.path)
    if problem is None:
        return beside if beside.is_file() else None
    return None if problem.path.resolve() == beside.resolve() else beside


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).digest()
