"""The planner `up:ENGINE`: any installed engine of unified-planning.

`up:enhsp` plans with the engine `enhsp`, at most 5 seconds for a plan; `up:enhsp:2` at most 2.

Importing this module without unified-planning raises `serp.errors.MissingExtra`.
"""

from __future__ import annotations

import contextlib
import json
import reprlib
import subprocess
import threading
import time
import warnings
import weakref
from importlib.util import find_spec
from typing import Any, Final

from serp._util.processes import python_command
from serp.errors import MissingExtra, Notice, SerpError, SettingsError
from serp.model.transition_model import TransitionModel, Vector
from serp.planning.plan_follower import PlanFollower
from serp.settings import PlannerSettings
from serp_adapters.unified_planning.translation import translated, values_in

if find_spec("unified_planning") is None:
    raise MissingExtra("a planner of unified-planning (`up:ENGINE`)", "up")

_SECONDS: Final = 5.0
"""Seconds for a plan, if the name says nothing else."""
_STARTING: Final = 60.0
"""Seconds for reading the problem."""
_GRACE: Final = 1.0
"""Seconds that an engine has for ending by itself, and its process after that."""


def make(model: TransitionModel, settings: PlannerSettings) -> PlanFollower:
    """Return the planner that follows plans of an engine of unified-planning, `up:ENGINE`.

    Raises:
        SettingsError: There is no such engine, or it does not take what the file says.
        DomainError: The file has no goal, or what no engine takes.
    """
    _, _, rest = settings.name.partition(":")
    engine, _, limit = rest.partition(":")
    seconds = 0.0
    with contextlib.suppress(ValueError):
        seconds = float(limit or _SECONDS)
    if not 0.0 < seconds < threading.TIMEOUT_MAX:
        raise SettingsError(
            f"planner.name: `{settings.name}` should end with a positive number of seconds, as in "
            f"`up:{engine}:2`"
        )
    return PlanFollower(model, settings, EnginePlans(model, engine, seconds))


class EnginePlans:
    """Plans of an engine, which works in a process of its own.

    The process is started again after a plan that took too long.

    Args:
        model: The transition model.
        engine: Name of the engine.
        seconds: Most seconds for a plan.
    """

    def __init__(self, model: TransitionModel, engine: str, seconds: float) -> None:
        self.model, self.engine, self.seconds = model, engine, seconds
        self._process: subprocess.Popen[str] | None = None
        self._told = False
        self._introduce()

    def __call__(self, state: Vector) -> list[int] | None:
        """Return the positions of the ground actions of a plan from a state `[F]`, or None."""
        try:
            if self._process is None or self.model.revision != self._revision:
                self._introduce()
            question = {"state": values_in(self._task, state), "seconds": self.seconds}
            answer = self._ask(question, self.seconds + _GRACE)
        except SerpError as error:  # it was used before, so a training goes on without it
            self._end()
            answer = {"error": str(error)}
        plan: list[int] | None = answer.get("plan")
        if plan is None and not self._told:
            self._told = True
            why = answer.get("status") or answer.get("error", "it did not say why")
            warnings.warn(
                f"planner `up:{self.engine}` found no plan ({why}), so `far-sight` decides; this "
                "message appears only once",
                Notice,
                stacklevel=2,
            )
        return plan

    def _introduce(self) -> None:
        """Tell the process what the model says now."""
        self._revision, self._task = self.model.revision, translated(self.model)
        if self._process is None:
            self._start()
        answer = self._ask({"engine": self.engine, "task": self._task}, _STARTING)
        if "error" in answer:
            self._end()
            raise SettingsError(f"planner.name: {answer['error']}")

    def _start(self) -> None:
        self._process = subprocess.Popen(
            python_command("serp_adapters.unified_planning.worker"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            encoding="utf-8",
        )
        self._finalizer = weakref.finalize(self, _finish, self._process)

    def _ask(self, question: dict[str, Any], seconds: float) -> dict[str, Any]:
        """Return the answer of the process; where there is none in time, end it."""
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        deadline = time.monotonic() + seconds
        timer = threading.Timer(seconds, _stop, [process])
        timer.daemon = True
        timer.start()
        line = ""
        try:
            with contextlib.suppress(OSError, ValueError):  # it is dead, or writes no text
                process.stdin.write(json.dumps(question) + "\n")
                process.stdin.flush()
                line = process.stdout.readline()
        except BaseException:  # Ctrl-C: a late answer must not be that of the next question
            self._end()
            raise
        finally:
            timer.cancel()
        answer = _answer_in(line, len(self.model.actions))
        if answer is not None:
            return answer
        late, whole = time.monotonic() >= deadline, line.endswith("\n")
        if not whole:  # so that its own end can be told from ours
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_GRACE)
        self._end()
        if late:
            return {"error": f"no answer in {seconds:g} seconds"}
        if whole:
            return {"error": f"its process wrote {reprlib.repr(line)}, which is not an answer"}
        code = process.returncode
        cause = "; not enough memory?" if code == -9 else ""
        return {"error": f"its process ended with exit status {code}{cause}"}

    def _end(self) -> None:
        if self._process is not None:
            self._finalizer()
            self._process = None


def _answer_in(line: str, actions: int) -> dict[str, Any] | None:
    """Return an answer whose plan consists of positions of actions; None for any other line."""
    try:
        answer = json.loads(line)
        plan = answer.get("plan")
        known = plan is None or all(type(k) is int and 0 <= k < actions for k in plan)
    except (ValueError, AttributeError, TypeError, RecursionError):
        return None
    return answer if known and line.endswith("\n") else None


def _finish(process: subprocess.Popen[str]) -> None:
    _stop(process)
    for pipe in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            if pipe is not None:
                pipe.close()


def _stop(process: subprocess.Popen[str]) -> None:
    """End a process, which ends what it has started where it can still do that."""
    process.terminate()
    try:
        process.wait(_GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
