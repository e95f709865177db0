"""What a rendered `DomainError` must look like."""

from __future__ import annotations

from serp.domain.source import DomainError


def caret_text(error: DomainError) -> str:
    """What stands above the carets."""
    _, source, carets = str(error).split("\n")[:3]
    begin = carets.index("^")
    assert carets[begin:] == "^" * (len(carets) - begin)
    return source[begin : len(carets)]


def check_rendering(error: DomainError, text: str) -> None:
    """The message opens with the place and quotes the line, with carets under the right text."""
    assert error.place is not None and error.line is not None and error.column is not None
    rows = str(error).split("\n")
    assert rows[0] == f"{error.file}:{error.line}:{error.column}: {error.problem}"
    line = text.split("\n")[error.line - 1]
    quoted = "".join(c if c.isprintable() else " " for c in line.removesuffix("\r"))
    assert error.source_line == quoted
    assert rows[1] == f"{error.line:>5} | {quoted}"
    place = text[error.place.start : error.place.end].split("\n")[0].removesuffix("\r")
    shown = "".join(c if c.isprintable() else " " for c in place)
    assert caret_text(error)[: len(shown)] == shown
    assert rows[2].count("^") == max(1, len(shown))
    assert rows[3:] == ([f"  {error.advice}"] if error.advice else [])
