"""Values on the command line: `section.name=value` and `fluent=value`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any

import click

from serp._util.text import did_you_mean
from serp.errors import SerpError


def parse_settings(assignments: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return section → setting → value of `section.name=value` texts.

    Values are JSON where they can be (numbers, true, false, null, lists), else text; `inf` is the
    infinity and `none` is null. Whether section and setting exist is for `serp.Settings` to say.

    Raises:
        UsageError: A text has another form, or a setting is given twice.
    """
    settings: dict[str, dict[str, Any]] = {}
    for text in assignments:
        target, equals, value = text.partition("=")
        section, dot, name = (part.strip() for part in target.partition("."))
        if not (equals and dot and section and name):
            raise click.UsageError(
                f"--set {text}: expected section.name=value, such as planner.depth=7"
            )
        if name in settings.setdefault(section, {}):
            raise click.UsageError(f"--set {section}.{name} is given twice")
        settings[section][name] = _setting(value.strip())
    return settings


def _setting(text: str) -> Any:
    if text in ("inf", "none", "None", "True", "False"):
        words = {"inf": float("inf"), "True": True, "False": False}
        return words.get(text)
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        return text
    return tuple(value) if isinstance(value, list) else value


def parse_state(
    assignments: Iterable[str], known: Mapping[str, bool], static: Iterable[str] = ()
) -> dict[str, float]:
    """Return fluent → value of `fluent=value` texts, several in one text apart by commas.

    Args:
        assignments: What was typed; a predicate takes `true` or `false` as well as 1 or 0.
        known: Name of every fluent → whether it is numeric.
        static: Names that the problem file fixes.

    Raises:
        UsageError: A text has another form.
        SerpError: A fluent is unknown or given twice, or a value is none that it can have.
    """
    state: dict[str, float] = {}
    fixed = set(static)
    for text in (part for whole in assignments for part in whole.split(",") if part.strip()):
        target, equals, value = text.partition("=")
        if not equals or not target.strip():
            raise click.UsageError(
                f"--state {text}: expected fluent=value, such as pole-angle=0.05"
            )
        name = " ".join(target.lower().strip().strip("()").split())
        if name in fixed:
            raise SerpError(f"--state: `{name}` is fixed by the problem file; change it there")
        if name not in known:
            raise SerpError(f"--state: unknown fluent `{name}`; {did_you_mean(name, known)}")
        if name in state:
            raise SerpError(f"--state: `{name}` is given twice")
        state[name] = _fluent_value(name, value.strip(), numeric=known[name])
    return state


def _fluent_value(name: str, text: str, *, numeric: bool) -> float:
    words = {} if numeric else {"true": 1.0, "false": 0.0}
    try:
        value = words[text.lower()] if text.lower() in words else float(text)
    except ValueError:
        value = float("nan")
    if value - value != 0.0 or (not numeric and value not in (0.0, 1.0)):
        wanted = "a finite number" if numeric else "true or false"
        raise SerpError(f"--state: `{name}` is {wanted}, not `{text}`")
    return value
