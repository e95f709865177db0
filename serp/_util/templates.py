"""The pages of reports: one Jinja environment for all templates."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape


def render(
    package: str, template: str, filters: dict[str, Callable[..., Any]] | None = None, **values: Any
) -> str:
    """Return a template of a package's folder `templates`, filled with values.

    Values are escaped in `*.html.j2`; an undefined name is an error.
    """
    environment = _environment(package)
    environment.filters |= filters or {}
    return environment.get_template(template).render(values)


@functools.cache  # with its compiled templates
def _environment(package: str) -> Environment:
    return Environment(
        loader=PackageLoader(package),
        autoescape=select_autoescape(["html.j2"], default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
