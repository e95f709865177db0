"""Commands of `serp play` and what they print."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from serp._util.number_format import readable
from serp._util.terminal import visible
from serp._util.text import did_you_mean, plural
from serp.cli.output import print_table
from serp.errors import SerpError
from serp.explanation.causes import Cause
from serp.explanation.refusals import schema_of
from serp.explanation.sentences import told

if TYPE_CHECKING:
    from rich.console import Console

    from serp.cli.chosen_planner import ChosenPlanner
    from serp.cli.state import MakePlanner
    from serp.planning.replanner import Plan
    from serp.play.changes import FluentChange
    from serp.play.game import Game, GameStep

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
        from serp.cli.decision import account_of_plan, print_plan

        game, (planner, plan) = self._game, self._plan()
        account = account_of_plan(planner, game.moment.state, plan)
        origin = f"after {plural(game.moment.steps, 'step')}"
        print_plan(self._console, game.moment.domain.name, origin, planner, account, plan)

    def _plan(self) -> tuple[ChosenPlanner, Plan]:
        """Plan in the world as it is; facts that were changed are another world.

        The first plan may have to wait for loops to be compiled.
        """
        from serp.training.compile_progress import show_compiling

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
