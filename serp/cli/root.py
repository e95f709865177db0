"""`serp` itself: its help, its version and the table of its commands."""

from __future__ import annotations

import click

from serp import __version__
from serp.cli.lazy import LazyGroup

COMMANDS = {
    "plan-and-learn": "Train: the planner acts first, the learner takes over.",
    "plan": "Show one decision of the planner, as a table or a picture.",
    "evaluate": "Measure a trained policy.",
    "compare": "Compare algorithms on one task, under one protocol.",
    "diagnose": "Say what a run found wrong or missing in its domain file.",
    "repair": "Write the domain file as a run would have it.",
    "watch": "See a trained policy act, in a window or on a film.",
    "check": "Say whether domain files are right, and what to mend.",
    "list": "List the installed tasks and the presets.",
}
"""Command → one line of help; `plan-and-learn` lives in the module `plan_and_learn`, and so on."""


@click.group(
    cls=LazyGroup,
    commands_in=("serp.cli.commands", COMMANDS),
    examples=(
        "serp plan-and-learn --domain cartpole",
        "serp plan --domain cartpole --svg decision.svg",
        "serp plan --help",
    ),
    epilog="Exit status: 0 done; 1 something in files, names or the environment has to be mended, "
    "and the message says what; 2 the command line is wrong; 128 + n stopped by signal n (130: "
    "Ctrl-C). With SERP_DEBUG=1 an error shows where in the program it arose.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="serp", message="%(prog)s %(version)s")
def serp() -> None:
    """From an expert's PDDL file to a safe, explained, trained policy."""
