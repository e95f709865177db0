"""A problem of unified-planning as a transition model, and what the model says of it in return."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any, Final

from unified_planning.engines import CompilationKind
from unified_planning.engines.compilers import BoundedTypesRemover, StateInvariantsRemover
from unified_planning.engines.compilers.usertype_fluents_remover import UsertypeFluentsRemover
from unified_planning.io import PDDLWriter
from unified_planning.model import FNode, Problem
from unified_planning.plans import ActionInstance

from serp.model.domain import Domain
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.source import Source

_RESERVED: Final = ("reward", "unsafe", "terminal", "total-cost")
"""Names that have a meaning of their own in our files, and that of the writer's own fluent."""
_COMPILERS: Final = (
    ("OBJECT_FLUENTS", UsertypeFluentsRemover, CompilationKind.USERTYPE_FLUENTS_REMOVING),
    ("STATE_INVARIANTS", StateInvariantsRemover, CompilationKind.STATE_INVARIANTS_REMOVING),
    ("BOUNDED_TYPES", BoundedTypesRemover, CompilationKind.BOUNDED_TYPES_REMOVING),
)
"""What PDDL cannot say, or our files not, and unified-planning's compiler that removes it."""


class ConvertedProblem:
    """A problem of unified-planning as a transition model.

    It goes through PDDL text: that is the one form which both sides define.

    Args:
        problem: The problem.

    Attributes:
        model: The model. Reaching the goal is a reward, and so is what the metric gains.

    Raises:
        DomainError: The text is not supported, or there are too many ground actions.
    """

    def __init__(self, problem: Problem) -> None:
        self._back: list[Any] = []
        for feature, compiler, kind in _COMPILERS:
            if feature in problem.kind.features:
                result = compiler().compile(problem, kind)
                problem = result.problem
                self._back.insert(0, result.map_back_action_instance)
        self._expressions = problem.environment.expression_manager
        # Assignments of conditions become conditional effects, which our files have.
        writer = PDDLWriter(problem, rewrite_bool_assignments=True)
        for fluent in problem.fluents:
            if fluent.name.lower() in _RESERVED:
                other = _unused(f"{fluent.name.lower()}-fluent", problem, writer)
                writer.otn_renamings[fluent], writer.nto_renamings[other] = other, fluent
        text = writer.get_domain(), writer.get_problem()
        domain = Domain.parse(
            Source("the problem's domain", text[0]), Source("the problem", text[1])
        )
        self.model = TransitionModel(domain.model.ground)
        self._item_named = writer.get_item_named

    def instance(self, action: int) -> ActionInstance:
        """Return a ground action as an instance of the problem's action."""
        ground = self.model.actions[action]
        objects = map(self._item_named, ground.arguments)
        instance = ActionInstance(
            self._item_named(ground.schema), tuple(map(self._expressions.ObjectExp, objects))
        )
        for back in self._back:
            instance = back(instance)
        return instance

    def observed(self, state: Vector, observation: Mapping[FNode, FNode]) -> Vector:
        """Return a state `[F]` in which fluents of the problem have other values.

        What the problem states and no action changes is no part of a state and left out.
        """
        changed = state.copy()
        for expression, value in observation.items():
            key = (expression.fluent().name, *(argument.object() for argument in expression.args))
            if value.is_object_exp():  # a predicate whose last argument is the value
                for other, column in self._columns.items():
                    if other[:-1] == key:
                        changed[column] = other[-1] == value.object()
            elif key in self._columns:
                changed[self._columns[key]] = float(value.constant_value())
        return changed

    @functools.cached_property
    def _columns(self) -> dict[tuple[Any, ...], int]:
        """Name of a fluent of the problem, and objects → column of a state."""
        return {
            (self._item_named(f.symbol).name, *map(self._item_named, f.arguments)): f.index
            for f in self.model.fluents
            if f.symbol != "total-cost"  # the writer's
        }


def _unused(name: str, problem: Problem, writer: Any) -> str:
    while problem.has_name(name) or name in writer.nto_renamings:
        name += "-"
    return name
