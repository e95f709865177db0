"""Small worlds of the tests: `NAME.pddl` here, and `NAME-problem.pddl` where there is one."""

from pathlib import Path

DOMAINS = Path(__file__).parents[2] / "domains"
"""The shipped files."""


def text(name):
    """The text of a file."""
    return (Path(__file__).parent / f"{name}.pddl").read_text(encoding="utf-8")
