"""Commands of `serp play` and what they print."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from serp._util.terminal import visible
from serp._util.text import did_you_mean, plural, readable
from serp.agent.causes import Cause
from serp.agent.refusals import schema_of
from serp.agent.registry import refuse_unknown_names
from serp.agent.sentences import told
from serp.errors import SerpError
from serp.model.domain import Domain
from serp.settings import Settings, resolve
from serp.tasks.task import Task
from serp.ui.output import print_table

if TYPE_CHECKING:
    from rich.console import Console

    from serp.authoring.play import FluentChange, Game, GameStep
    from serp.planning.replanner import Plan
    from serp.ui.planner import ChosenPlanner
    from serp.ui.state import MakePlanner


RESERVED: Final = "?purshq:"
"""Keys of the commands themselves."""
_AUTOMATIC: Final = "123456789abcdefgijklmnotvwxyz"
_NAMED: Final = {
    "up": ("\x1b[A", "\x1bOA", "\xe0H"),
    "down": ("\x1b[B", "\x1bOB", "\xe0P"),
    "right": ("\x1b[C", "\x1bOC", "\xe0M"),
    "left": ("\x1b[D", "\x1bOD", "\xe0K"),
    "space": (" ",),
}
"""Name of a key → what terminals, and Windows, send for it."""
_SENT: Final = {sent: name for name, several in _NAMED.items() for sent in several}


def action_keys(actions: Sequence[str], given: str | None) -> dict[str, str]:
    """Return key → action: those that are given as `key=action,...`, else one after the other.

    Where there are more actions than keys, the last ones have none.

    Raises:
        BadParameter: A key or an action does not exist, or a key is taken.
    """
    if given is None:
        return dict(zip(_AUTOMATIC, actions, strict=False))
    keys: dict[str, str] = {}
    for text in given.split(","):
        key, equals, action = (part.strip() for part in text.partition("="))
        known = len(key) == 1 or key in _NAMED
        if not equals or not known or key in RESERVED or key in keys or action not in actions:
            raise click.BadParameter(
                f"`{text}`: expected key=action, such as a={actions[0]} or left={actions[0]}; keys "
                f"are characters but {' '.join(RESERVED)}, and {', '.join(_NAMED)}; actions are "
                + ", ".join(actions),
                param_hint="--keys",
            )
        keys[key] = action
    return keys


class Keyboard:
    """The keys of the terminal that standard input is; a context manager.

    While it is open, keys come at once and without an echo; none that is pressed meanwhile is lost.
    """

    def __enter__(self) -> Keyboard:
        """Let keys come at once."""
        self._before: list[Any] | None = None
        with contextlib.suppress(ImportError):  # Windows: click asks its console
            import termios
            import tty

            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin, termios.TCSADRAIN)
        return self

    def __exit__(self, *error: object) -> None:
        """Leave the terminal as it was."""
        if self._before is not None:
            import termios

            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)

    def key(self) -> str:
        """Wait for a key; return its character or name, `enter` for the return key.

        Raises:
            KeyboardInterrupt: It was Ctrl-C.
            EOFError: It was Ctrl-D, or the terminal is gone.
        """
        sent = click.getchar() if self._before is None else self._sent()
        if sent in ("\r", "\n"):
            return "enter"
        return _SENT.get(sent, sent)

    def line(self, prompt: str) -> str:
        """Return a whole line, which the terminal lets its user edit."""
        self.__exit__()
        try:
            return input(prompt)
        finally:
            self.__enter__()

    def _sent(self) -> str:
        terminal = sys.stdin.fileno()
        sent = os.read(terminal, 1)
        if sent in (b"", b"\x04"):
            raise EOFError
        while sent[:1] == b"\x1b" and len(sent) < 3 and select.select([terminal], [], [], 0.05)[0]:
            sent += os.read(terminal, 1)
        while len(sent) < 4:
            try:
                return sent.decode()
            except UnicodeDecodeError:  # one of several bytes
                sent += os.read(terminal, 1)
        return sent.decode(errors="replace")


@dataclass(frozen=True)
class Playground:
    """A domain that is played by hand.

    Attributes:
        domain: The domain.
        task: The installed task that it belongs to; None for none.
        dt: Control period.
        changes: Section → setting → value.
        own_file: False for the file of an installed task, beside which nothing is written.
    """

    domain: Domain
    task: Task | None
    dt: float
    changes: Mapping[str, Mapping[str, Any]]
    own_file: bool

    def settings(self) -> Settings:
        """Return the settings that a training would have.

        Raises:
            SettingsError: There is no such setting or planner.
        """
        of_task = None if self.task is None else self.task.settings
        resolved = resolve("default", of_task, self.changes)
        refuse_unknown_names(resolved, self.task.planners if self.task else {})
        return resolved

    def planner(self, domain: Domain) -> ChosenPlanner:
        """Return the planner that a training would have in a world."""
        # Imported when the planner is asked, because this imports numba.
        from serp.ui.planner import chosen_planner

        model = domain.model.replace(dt=self.dt)
        return chosen_planner(model, self.settings().planner, self.task, 10.0)

    def save(self, title: str, game: Game, begun: Mapping[str, float]) -> str:
        """Write the situation of a game as a scenario, with what holds there; say where.

        Args:
            title: Title of the scenario; one that has it is replaced.
            game: The game.
            begun: Fluent → value with which it began, beside the problem.

        Raises:
            SerpError: It cannot be written, or nothing can be expected there.
        """
        from serp._util.files import write_durably
        from serp.authoring.scenarios.files import ScenarioFile, add_situation, scenarios_beside
        from serp.pddl.source import Source

        if not self.own_file:
            name = Path(self.domain.source.name).name
            raise SerpError(f"{name} is the file of an installed task; play a copy of it")
        if ";" in title:
            raise SerpError("a title has no `;`, which begins a comment")
        file, moment = scenarios_beside(self.domain), game.moment
        source = Source.read(file) if file.exists() else Source(str(file), "")
        known = {**begun, **moment.changed, **game.values}
        opened = ScenarioFile.open(
            source, self.domain.observed(known), self.settings(), self.dt, self.task
        )
        start = opened.decider.start
        values = {name: float(known.get(name, value)) for name, value in start.items()}
        remark = f"played by hand, after {plural(moment.steps, 'step')}"
        write_durably(file, add_situation(opened, title, values, remark))
        return f"{file}: the scenario `{title}` is written"


HELP: Final = (
    ("ACTION", "do it: its key, its name, the beginning of its name; `ACTION * 5`: five times"),
    ("?", "ask the planner: what each action would bring, and why"),
    ("p [N]", "let the planner act, N times"),
    ("u [N]", "undo the last step or change, N of them"),
    ("r", "restart where the game began"),
    ("s", "the state: all fluents, and what can be done"),
    ("FLUENT = VALUE", "change the state, such as `door-open hall = true`"),
    ("save TITLE", "write the situation as a scenario beside the file, for `serp test`"),
    ("h", "this help"),
    ("q", "quit"),
)
_WORDS: Final = {
    "plan": "?", "planner": "p", "undo": "u", "restart": "r", "state": "s", "help": "h",
    "quit": "q", "exit": "q",
}  # fmt: skip
_COUNTED: Final = re.compile(r"(?P<what>\?|[a-z]+)(?:\s+(?P<count>\d+))?")
_TIMES: Final = re.compile(r"(?P<action>.+?)\s*\*\s*(?P<count>\d+)")
_MOST: Final = 10_000
_SHOWN: Final = 24


class Player:
    """Carries out what is typed or pressed, and prints what comes of it.

    Args:
        game: The game.
        make_planner: Makes the planner of a domain.
        console: Where to print.
        keys: Key → name of an action.
        parse: Reads `FLUENT=VALUE,...` for the world as it is.
        save: Writes the situation as a scenario with a title, and says where.
    """

    def __init__(
        self,
        game: Game,
        make_planner: MakePlanner,
        console: Console,
        keys: Mapping[str, str],
        parse: Callable[[str], Mapping[str, float]],
        save: Callable[[str], str],
    ) -> None:
        self._game = game
        self._make_planner = make_planner
        self._console = console
        self._keys = keys
        self._parse = parse
        self._save = save
        self._planner: tuple[object, ChosenPlanner] | None = None

    def do(self, line: str) -> bool:
        """Carry out a command; return whether the game goes on.

        Raises:
            SerpError: There is no such command, or it cannot be carried out.
        """
        line = " ".join(line.removeprefix(":").split())
        if not line or line.startswith((";", "#")):
            return True
        action = self._keys.get(line, line)
        if line.startswith("save ") and line not in self._keys:
            self._console.print(self._save(line.removeprefix("save ")))
            return True
        if "=" in line and line not in self._keys:
            self._game.set(self._parse(line))
            self.print_state()
            return True
        counted = _COUNTED.fullmatch(action)
        what = counted["what"] if counted else ""
        what = _WORDS.get(what, what)
        if counted and what in ("?", *"pursh") and line not in self._keys:
            self._command(what, self._count(counted["count"]))
        elif what == "q" and line not in self._keys:
            return False
        else:
            times = _TIMES.fullmatch(action)
            number = self._find(times["action"] if times else action)
            self._repeat(lambda: number, self._count(times["count"] if times else None))
        return True

    def _command(self, what: str, count: int) -> None:
        match what:
            case "?":
                self._ask()
            case "p":
                self._repeat(self._planned, count)
            case "u":
                done = sum(self._game.undo() for _ in range(count))
                self._console.print(f"{done} taken back" if done else "there is nothing to undo")
                self.print_state()
            case "r":
                self._game.restart()
                self.print_state()
            case "s":
                self.print_state()
                self.print_actions()
            case _:
                print_table(self._console, ("", ""), HELP)

    def _count(self, text: str | None) -> int:
        count = 1 if text is None else int(text)
        if not 0 < count <= _MOST:
            raise SerpError(f"expected a number from 1 to {_MOST:,}, not {count:,}")
        return count

    def _find(self, name: str) -> int:
        """Return the position of the action that a name, or its beginning, means."""
        names = [action.name for action in self._game.model.actions]
        name = self._keys.get(name, name.lower().strip("()"))
        if name in names:
            return names.index(name)
        found = [k for k, known in enumerate(names) if known.startswith(name)]
        if len(found) == 1:
            return found[0]
        if found:
            raise SerpError(f"`{name}` may be {' or '.join(names[k] for k in found[:8])}")
        known = did_you_mean(name, [*names, *_WORDS, "save"])
        raise SerpError(f"there is no action or command `{name}`; {known} (h: help)")

    # Steps ---------------------------------------------------------------------------------------

    def _repeat(self, choose: Callable[[], int], count: int) -> None:
        for _ in range(count):
            played = self._game.step(choose())
            self._print_step(played)
            if played.over:
                break

    def _planned(self) -> int:
        _, plan = self._plan()
        if plan.action is None:
            raise SerpError("the planner has nothing to propose: no action is applicable")
        if plan.indifferent:
            self._console.print(
                "The planner is indifferent: all it sees is worth the same. A reward for coming "
                "nearer would show it the way.",
                style="dim",
            )
        return plan.action

    def _ask(self) -> None:
        from serp.ui.decision import account_of_plan, print_plan

        game, (planner, plan) = self._game, self._plan()
        account = account_of_plan(planner, game.moment.state, plan)
        origin = f"after {plural(game.moment.steps, 'step')}"
        print_plan(self._console, game.moment.domain.name, origin, planner, account, plan)

    def _plan(self) -> tuple[ChosenPlanner, Plan]:
        """Plan in the world as it is; facts that were changed are another world.

        The first plan may have to wait for loops to be compiled.
        """
        from serp.runs.progress import show_compiling

        moment = self._game.moment
        with show_compiling():
            if self._planner is None or self._planner[0] is not moment.world:
                self._planner = moment.world, self._make_planner(moment.domain.closed())
            planner = self._planner[1]
            return planner, planner.plan(moment.state)

    # Printing ------------------------------------------------------------------------------------

    def print_state(self) -> None:
        """Print where the game is: step, total, fluents."""
        moment, fluents = self._game.moment, self._game.model.fluents
        ended = ", over" if moment.over else ""
        self._console.print(
            f"after {plural(moment.steps, 'step')}, total {readable(moment.total)}{ended}",
            style="bold",
        )
        rows = [(f"  {fluent.name}", _value(self._game.values[fluent.name])) for fluent in fluents]
        print_table(self._console, ("", ""), rows[: 4 * _SHOWN])
        if len(rows) > 4 * _SHOWN:
            self._console.print(f"  … and {len(rows) - 4 * _SHOWN:,} more")

    def possible(self) -> str:
        """Return keys and names of what can be done now, as far as they fit in a line."""
        names = [action.name for action in self._game.model.actions]
        can = [
            f"{key} {name}"
            for key, name in self._keys.items()
            if not self._game.moment.over and not self._game.refusal(names.index(name))
        ]
        line = "  ".join(can)
        most = max(20, self._console.width - 4)
        return visible(line if len(line) <= most else f"{line[: most - 2]} …")

    def print_actions(self) -> None:
        """Print the actions with their keys; those that are not applicable are dim."""
        game, keys = self._game, {action: key for key, action in self._keys.items()}
        rows, styles = [], []
        for k, action in enumerate(game.model.actions[:_SHOWN]):
            refusal = game.refusal(k)
            rows.append((keys.get(action.name, ""), action.name, refusal))
            styles.append("dim" if refusal else "")
        print_table(self._console, ("", "", ""), rows, styles=styles)
        more = len(game.model.actions) - _SHOWN
        if more > 0:
            self._console.print(f"   … and {plural(more, 'more action')}, by name")

    def _print_step(self, played: GameStep) -> None:
        console, done = self._console, played.chosen
        if played.refusal:
            done += " is not applicable, and nothing is done"
        elif played.carried_out is None:
            done += " fails: nothing is done"
        elif played.carried_out != played.chosen:
            done += f" slips: {played.carried_out} happens instead"
        gain = f"reward {readable(played.reward)}, total {readable(played.total)}"
        console.print(f"step {played.number}: {done}; {gain}", style="bold")
        if played.refusal:
            console.print(f"   {played.refusal}")
        rows = [row for change in played.changes for row in _rows(change)]
        print_table(console, ("", "", "", ""), [("  ", *row) for row in rows])
        for cause in played.brought:
            style = "red" if cause.what == "unsafe" else ""
            console.print(f"   {told(cause)}", style=style)
        if played.over:
            console.print("The episode is over. r: restart, u: undo", style="bold")


def _rows(change: FluentChange) -> list[tuple[str, str, str]]:
    """Return the rows of a fluent that changed: its name, old → new, and what is behind it."""
    said = f"{_value(change.before)} → {_value(change.after)}"
    several = len(change.causes) > 1 or (change.noise and change.causes)
    reasons = [_reason(cause, with_amount=bool(several)) for cause in change.causes]
    if change.noise:
        reasons.append(f"{_signed(change.noise)} by chance")
    reasons = reasons or [""]
    heads = [(change.name, said), *[("", "")] * (len(reasons) - 1)]
    return [(*head, reason) for head, reason in zip(heads, reasons, strict=True)]


def _reason(cause: Cause, *, with_amount: bool) -> str:
    amount = f"{_signed(cause.amount or 0.0)} " if with_amount else ""
    comment = f": {cause.comment}" if cause.comment else ""
    line = "" if cause.place is None else f" (line {cause.place.line})"
    return f"{amount}by {schema_of(cause)}{line}{comment}"


def _signed(amount: float) -> str:
    return readable(amount) if amount < 0 else f"+{readable(amount)}"


def _value(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else readable(float(value))
