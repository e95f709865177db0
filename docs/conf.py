"""The documentation site. `sphinx-build -W --keep-going -n docs build/docs` needs no network."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

import click
import typst
from pygments import token
from pygments.lexer import RegexLexer, words
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.highlighting import lexers

from serp import __version__

project = "SErP"
author = "the SErP authors"
project_copyright = "2026, the SErP authors"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_click",
    "sphinx_copybutton",
    "sphinx_design",
    "settings_table",
]
exclude_patterns = ["build"]
templates_path = ["_templates"]

PDDL_WORDS = (
    "define", "domain", "problem", "and", "or", "not", "imply", "when", "forall", "exists",
    "assign", "increase", "decrease", "scale-up", "scale-down",
)  # fmt: skip


class PddlLexer(RegexLexer):
    """Pygments has none for PDDL, and that of Lisp takes names such as `position` for its own."""

    tokens = {  # noqa: RUF012
        "root": [
            (r"\s+", token.Whitespace),
            (r";.*", token.Comment.Single),
            (r"#t\b", token.Keyword.Constant),
            (r":[\w-]+", token.Keyword),
            (r"\?[\w-]+", token.Name.Variable),
            (r"-?\d+(\.\d+)?", token.Number),
            (words(PDDL_WORDS, prefix=r"(?<=\()", suffix=r"(?=[\s()])"), token.Name.Builtin),
            (r"[a-zA-Z][\w-]*", token.Name),
            (r"[<>=*/+-]+", token.Operator),
            (r"[()]", token.Punctuation),
            (r".", token.Text),
        ]
    }


lexers["pddl"] = PddlLexer()
lexers["csv"] = TextLexer()
smartquotes_action = "qe"  # `--` stays two hyphens: it begins an option
html_theme = "furo"
html_title = f"SErP {release}"
html_show_sourcelink = False
html_static_path = ["_static"]
html_css_files = ["site.css"]

myst_enable_extensions = ["attrs_block", "colon_fence", "deflist"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

# The public names are documented where they are exported, types in the description.
napoleon_use_ivar = True
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_typehints_format = "short"
autodoc_inherit_docstrings = False
napoleon_numpy_docstring = False
# Docstrings write code in single backquotes.
default_role = "code"

# No network: other libraries are named, not linked; nor are private names. A `word: text` that
# begins the docstring of a property is taken for a type.
nitpick_ignore_regex = [("py:.*", r"(?!serp\.[A-Za-z]\w*$).*")]

copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True


def examples_as_code(app: Sphinx, ctx: click.Context, lines: list[str]) -> None:
    """Turn the examples below a command's options into a block of code."""
    head, *shown = [line.lstrip("| ") for line in lines if line.strip()] or [""]
    block = [".. code-block:: sh", "", *(f"   {line}" for line in shown)] if shown else []
    lines[:] = [head, "", *block]


def technical_report(app: Sphinx, error: Exception | None) -> None:
    """Write the technical report beside the pages."""
    if error is None and app.builder.format == "html":
        source, root = app.srcdir / "report" / "report.typ", app.srcdir.parent
        typst.compile(source, output=app.outdir / "report.pdf", root=root)


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("sphinx-click-process-epilog", examples_as_code)
    app.connect("build-finished", technical_report)
