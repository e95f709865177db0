"""Commands of `serp play` and what they print."""

from __future__ import annotations

import contextlib
import functools
import itertools
import re
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click

from serp._util.did_you_mean import did_you_mean
from serp._util.files import write_durably
from serp._util.terminal import visible
from serp._util.text import plural, readable
from serp.agent.causes import Cause
from serp.agent.chosen_planner import ChosenPlanner
from serp.agent.sentences import line_of_run, signed
from serp.authoring.play import FluentChange, Game, GameStep
from serp.authoring.scenarios.checking import Decider, add_situation, scenarios_beside
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.pddl.source import Source
from serp.settings import Settings
from serp.tasks.task import Task
from serp.ui.account import print_plan
from serp.ui.options import parse_state
from serp.ui.output import print_table, show
from serp.ui.root import say

HELP: Final = (
    ("ACTION", "execute this action (its number, name or beginning); `ACTION * 5`: five times"),
    ("?", "ask the planner what each action would lead to, and why"),
    ("p [N]", "let the planner act (N times)"),
    ("u [N]", "undo the last step or change (the last N)"),
    ("r", "restart from the initial state"),
    ("s", "show the state: all fluents, and the applicable actions"),
    ("FLUENT = VALUE", "change the state, such as `door-open hall = true`"),
    ("save TITLE", "write the situation as a scenario beside the file, for `serp test`"),
    ("h", "show this help"),
    ("q", "quit"),
    ("", "on a terminal, an empty line repeats the last command"),
)


@dataclass
class Player:
    """Carries out commands in the world of a domain, and prints what happens.

    `own_file` is False for the file of an installed task, beside which nothing is written; `begun`
    has the values with which the game began, beside the problem.
    """

    domain: Domain
    task: Task | None
    dt: float
    settings: Settings
    own_file: bool
    game: Game
    begun: Mapping[str, float]

    def play(self, *, by_hand: bool) -> None:
        """Read commands from standard input, one a line, until one ends the game.

        A mistake ends it, too, unless it is played `by_hand`.
        """
        if by_hand:
            with contextlib.suppress(ImportError):
                import readline  # noqa: F401  (lines can be edited, and called back)
            show("? plan  p planner  u undo  r restart  s state  h help  q quit", style="dim")
        last = ""
        for number in itertools.count(1):
            try:
                line = input(f"{self._possible()} > ") or last if by_hand else input()
                if not self.do(line):
                    return
            except EOFError:
                if by_hand:
                    show()
                return
            except (SerpError, click.UsageError) as error:
                if not by_hand:
                    raise SerpError(f"line {number}: {error}") from error
                say(str(error))
            last = line

    def do(self, line: str) -> bool:
        """Carry out a command; return whether the game goes on."""
        line = " ".join(line.split())
        command = re.fullmatch(r"([?pursh])(?: (\d+))?", line)
        if line == "q":
            return False
        if not line or line.startswith((";", "#")):
            return True
        if command:
            self._command(command[1], _count(command[2]))
        elif line.startswith("save "):
            show(self._save(line.removeprefix("save ")))
        elif "=" in line:
            self.game.set(parse_state([line], self.game.domain, "change"))
            self.print_state()
        else:
            times = re.fullmatch(r"(?P<action>.+?) ?\* ?(?P<count>\d+)", line)
            action = self._find(times["action"] if times else line)
            self._repeat(lambda: action, _count(times["count"] if times else None))
        return True

    def _command(self, what: str, count: int) -> None:
        match what:
            case "?":
                self._ask()
            case "p":
                self._repeat(self._planned, count)
            case "u":
                undone = sum(self.game.undo() for _ in range(count))
                show(f"{undone} undone" if undone else "there is nothing to undo")
                self.print_state()
            case "r":
                self.game.restart()
                self.print_state()
            case "s":
                self.print_state()
                self.print_actions()
            case _:
                print_table(("", ""), HELP)

    def _find(self, name: str) -> int:
        """Return the position of the action that a number, a name, or its beginning means."""
        names = [action.name for action in self.game.model.actions]
        if name.isdecimal() and 0 < int(name) <= len(names):
            return int(name) - 1
        name = name.lower().strip("()")
        if name in names:
            return names.index(name)
        matches = [k for k, known in enumerate(names) if known.startswith(name)]
        if len(matches) == 1:
            return matches[0]
        if matches:
            raise SerpError(f"`{name}` may mean {' or '.join(names[k] for k in matches[:8])}")
        known = did_you_mean(name, [*names, "save"])
        raise SerpError(f"there is no action or command `{name}`; {known} (h: help)")

    def _repeat(self, choose: Callable[[], int], count: int) -> None:
        for _ in range(count):
            step = self.game.step(choose())
            self._print_step(step)
            if self.game.moment.over:
                break

    def _planned(self) -> int:
        plan = self._planner.plan(self.game.moment.state)
        if plan.action is None:
            raise SerpError("the planner has nothing to propose: no action is applicable")
        if plan.forecast.indifferent:
            show("The planner is indifferent: all actions are worth the same to it.", style="dim")
        return plan.action

    def _ask(self) -> None:
        moment, planner = self.game.moment, self._planner
        plan = planner.plan(moment.state)
        title = f"{self.domain.name}, after {plural(moment.steps, 'step')}"
        print_plan(title, planner, planner.explain(moment.state, plan), plan)

    @functools.cached_property
    def _planner(self) -> ChosenPlanner:
        """The planner that a training would have in this world."""
        return ChosenPlanner.of_settings(self.game.model, self.settings.planner, self.task)

    def _save(self, title: str) -> str:
        """Write the situation as a scenario, with what holds there; return a message.

        A scenario with the same title is replaced.
        """
        if not self.own_file:
            why = f"{Path(self.domain.source.name).name} belongs to an installed task"
            raise SerpError(f"{why}, so no scenario is saved beside it; play a copy of the file")
        file, moment = scenarios_beside(self.domain), self.game.moment
        source = Source.read(file) if file.exists() else Source(str(file), "")
        known = {**self.begun, **self.game.values}
        observed = self.domain.observed(known)
        decider = Decider.of_domain(source, observed, self.settings, self.dt, self.task)
        values = {name: float(known.get(name, value)) for name, value in decider.start.items()}
        remark = f"played by hand, after {plural(moment.steps, 'step')}"
        write_durably(file, add_situation(source, decider, title, values, remark))
        return f"{file}: the scenario `{title}` is written"

    def print_state(self) -> None:
        """Print where the game is: step, total, fluents."""
        moment, fluents = self.game.moment, self.game.model.fluents
        ended = ", over" if moment.over else ""
        steps = plural(moment.steps, "step")
        show(f"after {steps}, total {readable(moment.total)}{ended}", style="bold")
        rows = [(f"  {fluent.name}", readable(self.game.values[fluent.name])) for fluent in fluents]
        print_table(("", ""), rows[:96])
        if len(rows) > 96:
            show(f"  … and {len(rows) - 96:,} more")

    def _possible(self) -> str:
        """Return numbers and names of the applicable actions, as far as they fit in a line."""
        line = "  ".join(
            f"{k} {action.name}"
            for k, action in enumerate(self.game.model.actions, 1)
            if not self.game.moment.over and not self.game.refusal(k - 1)
        )
        most = max(20, shutil.get_terminal_size().columns - 4)
        return visible(line if len(line) <= most else f"{line[: most - 2]} …")

    def print_actions(self) -> None:
        """Print the actions with their numbers; those that are not applicable are dim."""
        actions = self.game.model.actions
        refusals = [self.game.refusal(k) for k in range(min(24, len(actions)))]
        rows = [(str(k + 1), actions[k].name, refusal) for k, refusal in enumerate(refusals)]
        styles = ["dim" if refusal else "" for refusal in refusals]
        print_table(("", "", ""), rows, styles=styles)
        if len(actions) > 24:
            show(f"   … and {plural(len(actions) - 24, 'more action')}, by name")

    def _print_step(self, step: GameStep) -> None:
        action, moment = step.chosen, self.game.moment
        if step.refusal:
            action += " is not applicable, so nothing is done"
        elif step.carried_out is None:
            action += " fails: nothing is done"
        elif step.carried_out != step.chosen:
            action += f" slips: {step.carried_out} happens instead"
        gain = f"reward {readable(step.reward)}, total {readable(moment.total)}"
        show(f"step {moment.steps - 1}: {action}; {gain}", style="bold")
        if step.refusal:
            show(f"   {step.refusal}")
        rows = [row for change in step.changes for row in _rows(change)]
        print_table(("", "", "", ""), [("  ", *row) for row in rows])
        for cause in step.brought:
            style = "red" if cause.what == "unsafe" else ""
            show(f"   {line_of_run([[cause]])}", style=style)
        if moment.over:
            show("The episode is over. r: restart, u: undo", style="bold")


def _count(text: str | None) -> int:
    most = 10_000
    count = 1 if text is None else int(text[:9])
    if not 0 < count <= most:
        raise SerpError(f"expected a number from 1 to {most:,}, not {text}")
    return count


def _rows(change: FluentChange) -> list[tuple[str, str, str]]:
    """Return the rows of a fluent that changed: its name, old → new, and what is behind it."""
    several = len(change.causes) > 1 or (change.noise and change.causes)
    reasons = [_reason(cause, with_amount=bool(several)) for cause in change.causes]
    if change.noise:
        reasons.append(f"{signed(change.noise)} by chance")
    values = f"{readable(change.before)} → {readable(change.after)}"
    first, *others = reasons or [""]
    return [(change.name, values, first), *(("", "", reason) for reason in others)]


def _reason(cause: Cause, *, with_amount: bool) -> str:
    amount = f"{signed(cause.amount or 0.0)} " if with_amount else ""
    comment = f": {cause.comment}" if cause.comment else ""
    line = "" if cause.place is None else f" (line {cause.place.line})"
    return f"{amount}by {cause.schema}{line}{comment}"
