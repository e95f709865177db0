"""Mending files by the fixes of findings, until none is left."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from serp._util.files import write_durably
from serp.authoring.lint.findings import Finding, findings_of
from serp.pddl.source import Edit, Source, edited

_MARK = "\ufeff".encode()


def mended(domain: Source, problem: Source | None = None) -> tuple[Source, Source | None]:
    """Return the files with every fix made that is sure, and with those that appear by it."""
    for _ in range(50):
        sources = [domain] if problem is None else [domain, problem]
        findings = findings_of(domain, problem)
        texts = [edited(source.text, _edits(findings, source)) for source in sources]
        if texts == [source.text for source in sources]:
            break
        domain = Source(domain.name, texts[0])
        problem = None if problem is None else Source(problem.name, texts[1])
    return domain, problem


def _edits(findings: Iterable[Finding], source: Source) -> list[Edit]:
    """Return the edits of sure fixes of a file that do not touch one another."""
    chosen: list[Edit] = []
    for finding in findings:
        fix, place = finding.fix, finding.place
        if fix is None or not fix.sure or place is None or place.source.name != source.name:
            continue
        if not any(e.start <= c.end and c.start <= e.end for e in fix.edits for c in chosen):
            chosen += fix.edits
    return chosen


def difference(before: Source, after: Source) -> str:
    """Return the unified difference of two versions of a file; empty where they are equal."""
    old, new = (source.text.splitlines(keepends=True) for source in (before, after))
    lines = difflib.unified_diff(old, new, before.name, f"{after.name} (changed)")
    return "".join(line if line.endswith("\n") else f"{line}\n" for line in lines)


def write_changed(texts: Mapping[Path, str]) -> None:
    """Replace files atomically; what the texts share with them stays byte by byte.

    Raises:
        RunError: A file cannot be written.
    """
    for path, text in texts.items():
        target = Path(os.path.realpath(path))
        mark = _MARK if target.read_bytes().startswith(_MARK) else b""
        mode = target.stat().st_mode
        write_durably(target, mark + text.encode())
        if target.stat().st_mode != mode:
            target.chmod(mode)
