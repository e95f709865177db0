"""The directive `settings-table`: every setting of a section, read from the code."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.docutils import SphinxDirective

from serp.settings import PRESETS, Settings, resolve


def value_text(value: Any) -> str:
    """Return a value as the command line takes it."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(str, value))}]"
    return str(value)


def range_text(schema: dict[str, Any]) -> str:
    """Return the values that a JSON schema allows, in words."""
    if "anyOf" in schema:
        return " or ".join(range_text(each) for each in schema["anyOf"])
    if "enum" in schema:
        return ", ".join(f"`{each}`" for each in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    match schema["type"]:
        case "null":
            return "none"
        case "boolean":
            return "true, false"
        case "string":
            return "a name"
        case "array":
            return f"list of: {range_text(schema['items'])}"
        case kind:
            return f"{'integer' if kind == 'integer' else 'number'}{bounds_text(schema)}"


def bounds_text(schema: dict[str, Any]) -> str:
    """Return the bounds of a number; bounds that only refuse absurd sizes are left out."""
    bounds = [
        f"{sign} {schema[key]:,}"
        for key, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "<"),
        )
        if key in schema and abs(schema[key]) < 1e9
    ]
    return f" {', '.join(bounds)}" if bounds else ""


class SettingsTable(SphinxDirective):
    """A table of the settings of the section that is its argument."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Write the table as Markdown and parse it in its place."""
        (section,) = self.arguments
        kind = type(getattr(Settings(), section))
        schema = kind.model_json_schema()
        texts = ModuleAnalyzer.for_module(kind.__module__).find_attr_docs()
        presets = {name: resolve(name).as_dict()[section] for name in PRESETS}
        rows = [
            "| setting | meaning | range | `default` | `paper` |",
            "|---|---|---|---|---|",
        ]
        for name, described in schema["properties"].items():
            meaning = " ".join(" ".join(texts[kind.__name__, name]).split())
            values = [f"`{value_text(presets[preset][name])}`" for preset in ("default", "paper")]
            cells = [f"`{name}`", meaning, range_text(described), *values]
            rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
        return self.parse_text_to_nodes("\n".join(rows))


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directive."""
    app.add_directive("settings-table", SettingsTable)
    return {"parallel_read_safe": True}
