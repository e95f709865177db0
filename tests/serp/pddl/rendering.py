"""What a rendered `DomainError` must look like."""

import re


def caret_text(error):
    """What stands above the carets."""
    _, source, carets = str(error).split("\n")[:3]
    begin = carets.index("^")
    assert carets[begin:] == "^" * (len(carets) - begin)
    return source[begin : len(carets)]


def check_rendering(error, text):
    """The message opens with the place and quotes the line, with carets under the right text."""
    assert error.place is not None and error.line is not None and error.column is not None
    rows = str(error).split("\n")
    assert rows[0] == f"{error.file}:{error.line}:{error.column}: {error.problem}"
    quoted = visible(lines(text)[error.line - 1])
    shown = visible(lines(text[error.place.start : error.place.end])[0])
    if len(quoted) <= 160:
        assert error.source_line == quoted
    else:  # what is around the place
        assert error.source_line.removeprefix("... ").removesuffix(" ...") in quoted
        assert len(error.source_line) <= 168
        shown = shown[:80]
    assert rows[1] == f"{error.line:>5} | {error.source_line}"
    assert caret_text(error)[: len(shown)] == shown
    assert len(quoted) > 160 or rows[2].count("^") == max(1, len(shown))
    corrected = ["  write", f"{error.line:>5} | {error.corrected_line}"]
    assert rows[3:] == ([f"  {error.advice}"] if error.advice else []) + (
        corrected if error.corrected_line else []
    )


def lines(text):
    return re.split("\r\n|\r|\n", text)


def visible(text):
    return "".join(c if c.isprintable() else " " for c in text)
