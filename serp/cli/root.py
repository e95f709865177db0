"""`serp` itself: its help, its version and its commands, each imported when it is used."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import click

from serp import __version__
from serp.cli.failures import exit_with
from serp.cli.output import write_examples

COMMANDS = {
    "plan-and-learn": "Train: the planner acts first, the learner takes over.",
    "plan": "Show one decision of the planner, as a table or a picture.",
    "evaluate": "Measure a trained policy.",
    "compare": "Compare algorithms on one task, under one protocol.",
    "diagnose": "Report what is wrong or missing in a run's domain file.",
    "repair": "Write a run's domain file, corrected by what it observed.",
    "watch": "Show a trained policy in a window or as a film.",
    "check": "Check domain files and say what to fix.",
    "list": "List the installed tasks and the presets.",
}
"""Command → one line of help; `plan-and-learn` lives in the module `plan_and_learn`, and so on."""


class LazyGroup(click.Group):
    """Commands by name and one line of help; `serp --help` imports none of them.

    Args:
        commands_in: The package that holds the modules, and name → help. The command `a-b` is the
            attribute `command` of the module `a_b`.
        examples: Command lines for the help.
    """

    def __init__(
        self,
        *args: Any,
        commands_in: tuple[str, Mapping[str, str]],
        examples: Sequence[str],
        **options: Any,
    ) -> None:
        super().__init__(*args, **options)
        self._package, self._summaries = commands_in
        self.examples = tuple(examples)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order in which they are of use."""
        return list(self._summaries)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command; None where there is none of that name."""
        if cmd_name not in self._summaries:
            return None
        module = import_module(f"{self._package}.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that the arguments begin with.

        Raises:
            UsageError: There is none; says which one may be meant.
        """
        try:
            return super().resolve_command(ctx, args)
        except click.UsageError:
            if args[0].startswith("-"):
                raise
            close = difflib.get_close_matches(args[0], self._summaries, n=1)
            advice = f"Did you mean '{close[0]}'?" if close else f"Try {self._listed()}."
            raise click.UsageError(f"there is no command '{args[0]}'. {advice}", ctx) from None

    def _listed(self) -> str:
        *most, last = self._summaries
        return f"{', '.join(most)} or {last}"

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._summaries.items()))

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the examples, then what else there is to say."""
        write_examples(formatter, self.examples)
        super().format_epilog(ctx, formatter)

    def main(
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        **extra: Any,
    ) -> Any:
        """Run a command; in standalone mode errors become messages, and the process exits."""

        def run() -> Any:
            return super(LazyGroup, self).main(
                args, prog_name, complete_var, standalone_mode=False, **extra
            )

        return exit_with(run) if standalone_mode else run()


@click.group(
    cls=LazyGroup,
    commands_in=("serp.cli.commands", COMMANDS),
    examples=(
        "serp plan-and-learn --domain cartpole",
        "serp plan --domain cartpole --svg decision.svg",
        "serp plan --help",
    ),
    epilog="Exit status: 0 done; 1 a file, a name or the environment is wrong, "
    "and the message says what; 2 the command line is wrong; 128 + n stopped by signal n (130: "
    "Ctrl-C). With SERP_DEBUG=1 an error shows its traceback.",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="serp", message="%(prog)s %(version)s")
def serp() -> None:
    """From an expert's PDDL file to a safe, explained, trained policy."""
