"""A task whose environment runs in a process of its own, so that several run at the same time."""

from __future__ import annotations

import contextlib
import multiprocessing
import sys
import traceback
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

from gymnasium.vector.utils import CloudpickleWrapper

from serp._util.files import Closing
from serp._util.processes import follow_parent, safe_path, unsafe_path
from serp.errors import EnvironmentFailure, SerpError
from serp.model.transition_model import Vector
from serp.tasks.environment import BoundTask


class RemoteTask(Closing):
    """A task with an environment in a process of its own.

    The process checks, copies and grounds what the environment returns, as `BoundTask` does.
    Gymnasium's `AsyncVectorEnv` joins the answers of all environments, and has one seed for all.
    Messages have the number of the environment, from 1.
    """

    def __init__(self, task: BoundTask, number: int) -> None:
        self._task, self._number = task, number
        self._perceived: tuple[Vector, Vector]
        # `fork` needs no import and no `__main__` guard in a user's script.
        context: Any = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
        self._pipe, other = context.Pipe()
        bind: Any = task.task.bind
        arguments = other, CloudpickleWrapper(bind)  # pickles closures, too
        self._process = context.Process(target=_serve, args=arguments, daemon=True)
        with safe_path():
            self._process.start()
        other.close()
        self._pending: tuple[str, tuple[Any, ...]] | None = ("", ())

    def wait_until_made(self) -> None:
        """Wait until the environment is made; raise the error if that failed."""
        self._answer("making the environment")

    def reset(self, seed: int) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, or wait for a reset that was begun; see `BoundTask.reset`."""
        answer: tuple[Any, dict[str, Any]]
        answer, self._perceived = self._do("reset", seed, doing="reset")
        return answer

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Execute an action, or wait for a step that was begun; see `reset`."""
        answer: tuple[Any, float, bool, bool, dict[str, Any]]
        name = self._task.actions.name(action)
        answer, self._perceived = self._do("step", action, doing=f"step with action {name}")
        return answer

    def perceived(self, raw: Any, info: Mapping[str, Any]) -> tuple[Vector, Vector]:
        """Return flat observation and state of the newest answer; see `BoundTask.perceived`."""
        return self._perceived

    def environment_state(self) -> dict[str, Any]:
        """Return what `BoundTask.environment_state` returns."""
        state: dict[str, Any] = self._do("environment_state", doing="saving the environment")
        return state

    def restore_environment(self, saved: Mapping[str, Any]) -> None:
        """Restore what `environment_state` returned."""
        self._do("restore_environment", saved, doing="restoring the environment")

    def close(self) -> None:
        """Close the environment and end its process."""
        try:
            if self._process.is_alive() and self._pending is None:  # not stuck, busy or dead
                self._do("close", doing="closing the environment")
        finally:
            self._pipe.close()
            self._process.kill()
            self._process.join()

    def begin(self, what: str, *arguments: Any) -> None:
        """Begin a method, such as `reset` or `step`, without waiting for it."""
        assert self._pending is None, f"{self._pending} was not answered"
        self._pending = what, arguments
        with contextlib.suppress(OSError):  # it is dead, which `_answer` tells
            self._pipe.send((what, arguments))

    def _do(self, what: str, *arguments: Any, doing: str) -> Any:
        if self._pending is None:
            self.begin(what, *arguments)
        assert self._pending == (what, arguments), f"{self._pending} was begun, not {what}"
        return self._answer(doing)

    def _answer(self, doing: str) -> Any:
        try:
            answer = self._pipe.recv()
        except (EOFError, OSError):
            raise EnvironmentFailure(
                f"task {self._task.name}: {doing} failed: the process of environment "
                f"{self._number} died; not enough memory?"
            ) from None
        self._pending = None
        if isinstance(answer, Exception):
            answer.add_note(f"It happened in environment {self._number}.")
            raise answer
        return answer


def _serve(pipe: Connection, bind: Callable[[], BoundTask]) -> None:
    """Make the environment in this process, and answer calls of its methods until it is closed."""
    follow_parent()
    unsafe_path()
    try:
        task = bind()
    except Exception as error:
        pipe.send(error)
        return
    pipe.send(None)
    method = ""
    while method != "close":
        method, arguments = pipe.recv()
        try:
            answer = getattr(task, method)(*arguments)
            if method in ("reset", "step"):
                raw, info = answer[0], answer[-1]
                answer = answer, task.perceived(raw, info)
        except Exception as error:
            answer = error
            if not isinstance(error, SerpError):
                answer.add_note(traceback.format_exc())
        _send(pipe, answer, task.name, method)


def _send(pipe: Connection, answer: Any, task: str, method: str) -> None:
    try:
        pipe.send(answer)
    except Exception as error:  # whatever the environment's objects raise
        pipe.send(
            EnvironmentFailure(
                f"task {task}: what {method} returned cannot be sent from another process: "
                f"{type(error).__name__}: {error}; let it consist of plain values"
            )
        )
