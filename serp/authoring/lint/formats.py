"""Findings for other programs: JSON and SARIF 2.1.0."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote

from serp import __version__
from serp.authoring.lint.codes import CODES
from serp.authoring.lint.findings import Finding, spot

_SARIF = "https://json.schemastore.org/sarif-2.1.0.json"
_HELP = "docs/reference/checks.md has an example of each code, and how a warning is silenced."


def as_json(findings: Iterable[Finding]) -> str:
    """Return a JSON array with an object a finding (`Finding.as_dict`)."""
    return json.dumps([finding.as_dict() for finding in findings], indent=2, ensure_ascii=False)


def as_sarif(findings: Iterable[Finding]) -> str:
    """Return a log in the Static Analysis Results Interchange Format (OASIS, 2020), version 2.1.0.

    Columns count characters (`unicodeCodePoints`); files are named relative to the working folder
    where they lie in it.
    """
    results = list(findings)
    codes = sorted({finding.code for finding in results})
    rules = []
    for code in codes:
        meaning = {"text": CODES.get(code, code)}
        rules.append({"id": code, "shortDescription": meaning, "fullDescription": meaning,
                      "help": {"text": f"{meaning['text']} {_HELP}"}})  # fmt: skip
    run = {
        "tool": {"driver": {"name": "serp check", "version": __version__, "rules": rules}},
        "columnKind": "unicodeCodePoints",
        "results": [_result(finding, codes) for finding in results],
    }
    log = {"$schema": _SARIF, "version": "2.1.0", "runs": [run]}
    return json.dumps(log, indent=2, ensure_ascii=False)


def _result(finding: Finding, codes: Sequence[str]) -> dict[str, Any]:
    text = finding.message + (f" ({finding.advice})" if finding.advice else "")
    result: dict[str, Any] = {
        "ruleId": finding.code,
        "ruleIndex": codes.index(finding.code),
        "level": finding.severity,
        "message": {"text": text},
    }
    place = finding.place
    # GitHub refuses a result without a location.
    artifact = {"uri": _uri(place.source.name) if place is not None else "."}
    physical: dict[str, Any] = {"artifactLocation": artifact}
    result["locations"] = [{"physicalLocation": physical}]
    if place is None:
        return result
    physical["region"] = _region(spot(place))
    if finding.fix is not None:
        replacements = [
            {
                "deletedRegion": _region(spot(place.source.place(edit.start, edit.end))),
                "insertedContent": {"text": edit.text},
            }
            for edit in finding.fix.edits
        ]
        changes = [{"artifactLocation": artifact, "replacements": replacements}]
        result["fixes"] = [{"artifactChanges": changes}]
    return result


def _region(at: dict[str, int]) -> dict[str, int]:
    return {
        "startLine": at["line"],
        "startColumn": at["column"],
        "endLine": at["end_line"],
        "endColumn": at["end_column"],
    }


def _uri(name: str) -> str:
    path = Path(name)
    if path.is_absolute() and path.is_relative_to(Path.cwd()):
        path = path.relative_to(Path.cwd())
    return path.as_uri() if path.is_absolute() else quote(str(PurePosixPath(path)))


FORMATS = {"json": as_json, "sarif": as_sarif}
"""Name → what writes findings in that format."""
