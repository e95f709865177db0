"""The process in which an engine of unified-planning plans, so that it can be ended.

It reads lines of JSON: the name of an engine and a problem as `translation` makes it, then a state
and a number of seconds for each plan that is wanted, perhaps another problem. To each it answers
with a line: nothing, `error`, or a `plan` (null where there is none) with the engine's `status`.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
import os
import queue
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any, Final, TextIO

from unified_planning.engines import CompilationKind, PlanGenerationResultStatus
from unified_planning.engines.factory import DEFAULT_ENGINES
from unified_planning.engines.pddl_planner import terminate_process
from unified_planning.model import FNode, InstantaneousAction, Problem
from unified_planning.model.metrics import MinimizeActionCosts
from unified_planning.plans import PlanKind
from unified_planning.shortcuts import BoolType, Fluent, RealType, get_environment

_GRACE: Final = 0.5
"""Seconds that an engine's own processes have for ending by themselves; the parent waits longer."""
_COMPILED: Final = {
    "CONDITIONAL_EFFECTS": CompilationKind.CONDITIONAL_EFFECTS_REMOVING,
    "DISJUNCTIVE_CONDITIONS": CompilationKind.DISJUNCTIVE_CONDITIONS_REMOVING,
    "NEGATIVE_CONDITIONS": CompilationKind.NEGATIVE_CONDITIONS_REMOVING,
}
"""What unified-planning can remove from a problem before an engine that does not take it plans."""
MOST_VARIANTS: Final = 4_000
"""Most actions that those with disjunctions become; for each plan they take a millisecond each."""


class _Fixed(Problem):  # type: ignore[misc]
    """A problem whose kind is found once.

    That takes a second for a thousand actions, and an engine asks seven times for each plan.
    """

    @functools.cached_property
    def kind(self) -> Any:
        """What the problem needs."""
        return super().kind


class Refused(Exception):
    """An engine cannot be used."""


class Planning:
    """An engine and a problem.

    Args:
        engine: Name of the engine.
        task: The problem, as `translation.translated` describes it.

    Raises:
        Refused: There is no such engine, or it does not take the problem.
    """

    def __init__(self, engine: str, task: Mapping[str, Any]) -> None:
        environment = get_environment()
        environment.credits_stream = None
        self.factory, self.engine_name = environment.factory, engine
        installed = [
            name for name in self.factory.engines
            if "[" not in name and self.factory.engine(name).is_oneshot_planner()
        ]  # fmt: skip
        if not engine:
            raise Refused(
                f"name an engine, as in `up:{installed[0]}`; installed: {', '.join(installed)}"
            )
        if engine not in installed:
            package = DEFAULT_ENGINES.get(engine, ("up-NAME",))[0].partition(".")[0]
            raise Refused(
                f"unified-planning has no engine `{engine}`; installed: {', '.join(installed)}; "
                f"to add it: pip install {package.replace('_', '-')}"
            )
        self.engine = self.factory.engine(engine)()
        self.problem = problem_of(task)
        if not self._accepts(self.problem.kind) and self.problem.quality_metrics:
            self.problem.clear_quality_metrics()
            del self.problem.kind
        if not self._accepts(self.problem.kind):
            self._refuse(installed)
        missing = self.problem.kind.features - self.engine.supported_kind().features
        if "CONDITIONAL_EFFECTS" in missing:  # what takes their place, is compiled away, too
            missing |= _COMPILED.keys() - self.engine.supported_kind().features
        self.kinds = [kind for feature, kind in _COMPILED.items() if feature in missing]
        split = sum(_variants(conditions, effects) for _, conditions, effects in task["actions"])
        if "DISJUNCTIVE_CONDITIONS" in missing and split > MOST_VARIANTS:
            raise Refused(
                f"the engine `{engine}` takes no disjunctions. Splitting them gives {split} "
                f"actions, more than {MOST_VARIANTS}. Use an engine that takes disjunctions, such "
                "as `enhsp`"
            )

    def _accepts(self, kind: Any) -> bool:
        return bool(kind.features - self.engine.supported_kind().features <= _COMPILED.keys())

    def _refuse(self, installed: Sequence[str]) -> None:
        features = self.problem.kind.features
        missing = features - self.engine.supported_kind().features - _COMPILED.keys()
        others = [
            name for name in installed
            if features - self.factory.engine(name).supported_kind().features <= _COMPILED.keys()
        ]  # fmt: skip
        raise Refused(
            f"the engine `{self.engine_name}` does not take {', '.join(sorted(missing))}, which "
            f"this file needs; installed engines that do: {', '.join(others) or 'none'}"
        )

    def plan(self, state: Mapping[str, float | bool], seconds: float) -> dict[str, Any]:
        """Return positions of the ground actions of a plan, and the status."""
        deadline = time.monotonic() + seconds
        begin_at(self.problem, state)
        problem, back = self.problem, None
        if self.kinds:
            with self.factory.Compiler(
                problem_kind=problem.kind, compilation_kinds=self.kinds
            ) as compiler:
                result = compiler.compile(problem)
            problem, back = result.problem, result.map_back_action_instance
        left = max(0.1, deadline - time.monotonic())
        self.engine.skip_checks = True  # they were made once
        result = self.engine.solve(problem, timeout=left)
        plan = result.plan
        if plan is None or result.status not in _SOLVED:
            return {"plan": None, "status": result.status.name}
        if back is not None:
            plan = plan.replace_action_instances(back)
        if plan.kind is not PlanKind.SEQUENTIAL_PLAN:
            plan = plan.convert_to(PlanKind.SEQUENTIAL_PLAN, self.problem)
        positions = [int(step.action.name[1:]) for step in plan.actions]
        return {"plan": positions, "status": result.status.name}

    def end(self) -> None:
        """End what the engine has started."""
        process = getattr(self.engine, "_process", None)  # of engines that are other programs
        if process is not None:
            end_group(process)


def end_group(process: subprocess.Popen[bytes]) -> None:
    """End a process that leads a group, and what is left of the group after half a second."""
    terminate_process(process)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_GRACE)
    with contextlib.suppress(ProcessLookupError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


_SOLVED: Final = (
    PlanGenerationResultStatus.SOLVED_SATISFICING,
    PlanGenerationResultStatus.SOLVED_OPTIMALLY,
    PlanGenerationResultStatus.TIMEOUT,  # with the best plan so far
)


def problem_of(task: Mapping[str, Any]) -> _Fixed:
    """Return the problem that `translation.translated` describes, all fluents 0 or false."""
    problem = _Fixed("task")
    fluents: dict[str, FNode] = {}
    for name, (_, numeric) in task["fluents"].items():
        kind, start = (RealType(), 0) if numeric else (BoolType(), False)
        fluents[name] = problem.add_fluent(Fluent(name, kind), default_initial_value=start)()
    built = functools.partial(_expression, fluents)
    costs: dict[InstantaneousAction, Any] = {}
    for position, preconditions, effects in task["actions"]:
        action = InstantaneousAction(f"a{position}")
        for test in preconditions:
            action.add_precondition(built(test))
        # Where a predicate becomes both true and false, it becomes true.
        made = {(name, str(test)) for _, name, value, test in effects if value is True}
        for change, name, value, test in effects:
            if value is False and (name, str(test)) in made:
                continue
            add = {
                "assign": action.add_effect,
                "increase": action.add_increase_effect,
                "decrease": action.add_decrease_effect,
            }[change]
            add(fluents[name], built(value), built(test))
        problem.add_action(action)
        if task["costs"] is not None:
            costs[action] = built(task["costs"][position])
    if costs:
        problem.add_quality_metric(MinimizeActionCosts(costs))
    problem.add_goal(built(task["goal"]))
    return problem


def _variants(conditions: Sequence[Any], effects: Sequence[Any]) -> int:
    """Return how many actions without disjunctions and conditional effects one becomes."""
    given = {str(test): test for *_, test in effects if test is not True}
    both = (_ways(test) + _ways(test, wanted=False) for test in given.values())
    return math.prod(map(_ways, conditions)) * math.prod(both)


def _ways(test: Any, wanted: bool = True) -> int:
    """Return in how many ways a condition holds, or does not."""
    match test:
        case ["not", operand]:
            return _ways(operand, not wanted)
        case ["and" | "or" as operator, *operands]:
            each = [_ways(operand, wanted) for operand in operands]
            return math.prod(each) if (operator == "and") == wanted else sum(each)
        case _:
            return 1


def begin_at(problem: Problem, state: Mapping[str, float | bool]) -> None:
    """Make a state, the values of fluents by their names, the initial one of a problem."""
    for name, value in state.items():
        problem.set_initial_value(problem.fluent(name)(), _number(value))


def _expression(fluents: Mapping[str, FNode], node: Any) -> Any:
    """Return an expression of unified-planning."""
    if isinstance(node, str):
        return fluents[node]
    if not isinstance(node, list):
        return _number(node)
    em = get_environment().expression_manager
    operator, *operands = node
    make: dict[str, Callable[..., FNode]] = {
        "and": em.And, "or": em.Or, "not": em.Not, "=": em.Equals, "<": em.LT, "<=": em.LE,
        ">": em.GT, ">=": em.GE, "+": em.Plus, "-": em.Minus, "*": em.Times, "/": em.Div,
    }  # fmt: skip
    return make[operator](*(_expression(fluents, operand) for operand in operands))


def _number(value: float | bool) -> bool | int | Fraction:
    if isinstance(value, bool):
        return value
    return int(value) if float(value).is_integer() else Fraction(repr(float(value)))


def serve(lines: TextIO, answers: TextIO) -> None:
    """Answer one line after another; where there are no more, end, in the middle of a plan, too."""
    planning: Planning | None = None
    questions: queue.SimpleQueue[str] = queue.SimpleQueue()

    def end(*_: object) -> None:
        if planning is not None:
            planning.end()
        os._exit(1)

    def read() -> None:
        for line in lines:
            questions.put(line)
        end()  # the parent is no more

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    signal.signal(signal.SIGTERM, end)
    warnings.simplefilter("ignore")
    threading.Thread(target=read, daemon=True).start()
    while True:
        answer: dict[str, Any] = {}
        try:
            asked = json.loads(questions.get())
            if "task" in asked:
                planning = Planning(asked["engine"], asked["task"])
            elif planning is not None:
                answer = planning.plan(asked["state"], asked["seconds"])
        except Refused as error:
            answer = {"error": str(error)}
        except Exception as error:  # whatever an engine raises
            answer = {"error": f"{type(error).__name__}: {error}"}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


if __name__ == "__main__":
    own = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # engines may print
    serve(sys.stdin, own)
