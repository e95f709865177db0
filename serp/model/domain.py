"""Loading a domain: files → parsed → instantiated → transition model."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import gc
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from serp.model.grounder import instantiate
from serp.model.reachability import MAX_GROUND_SCHEMAS
from serp.model.transition_model import TransitionModel
from serp.pddl import syntax as x
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import DomainWarning, Source


@dataclass(frozen=True)
class Domain:
    """A domain file with its optional problem file, checked and ready to be compiled.

    Attributes:
        source: The domain file.
        problem_source: The problem file, or None.
        syntax: The domain as written.
        problem_syntax: The problem as written, or None.
        max_ground_schemas: Most ground actions, processes and events together.
        supplied: None where all states can be reached from the problem's `:init`. Otherwise states
            are observed (see `observed`), and the names are those of facts of `:init` that are
            observed as well.
    """

    source: Source
    problem_source: Source | None
    syntax: x.DomainSyntax = field(repr=False)
    problem_syntax: x.ProblemSyntax | None = field(repr=False)
    max_ground_schemas: int = MAX_GROUND_SCHEMAS
    supplied: frozenset[str] | None = None

    @classmethod
    def parse(
        cls,
        source: Source,
        problem_source: Source | None = None,
        *,
        observed: bool = False,
        max_ground_schemas: int | None = None,
    ) -> Domain:
        """Parse the files, without instantiating them; see `load_domain` for the arguments."""
        syntax = parse_domain(source)
        problem = parse_problem(problem_source, syntax) if problem_source is not None else None
        limit = MAX_GROUND_SCHEMAS if max_ground_schemas is None else max_ground_schemas
        supplied = frozenset[str]() if observed else None
        return cls(source, problem_source, syntax, problem, limit, supplied)

    def __getstate__(self) -> dict[str, object]:
        """Leave the model out of a pickle: another process compiles its own."""
        return {name: value for name, value in vars(self).items() if name != "model"}

    @property
    def name(self) -> str:
        """The domain's name."""
        return self.syntax.name

    @property
    def sources(self) -> tuple[Source, ...]:
        """The domain file and, if there is one, the problem file."""
        return (self.source,) if self.problem_source is None else (self.source, self.problem_source)

    @property
    def warnings(self) -> tuple[DomainWarning, ...]:
        """Remarks on the files that are not errors, such as syntax that other tools refuse."""
        return tuple(dict.fromkeys(w for source in self.sources for w in source.warnings))

    def observed(self, supplied: Iterable[str] = ()) -> Domain:
        """Return the same domain for states that come from an environment.

        They need not be reachable from the problem's `:init`, so the model keeps what is
        unreachable from there.

        Args:
            supplied: Names of fluents that are observed. Where `:init` states one that no effect
                changes, its value there is only the initial one.
        """
        problem, names = self.problem_syntax, set(supplied)
        if self.supplied is None and problem is not None and problem.has_init:
            return dataclasses.replace(self, supplied=frozenset()).observed(names)
        if not names:
            return self
        varying = {fluent.name for fluent in self.model.fluents}
        fixed = frozenset(n for n in names if n not in varying and self.declared(n) is not None)
        if not fixed:
            return self
        return dataclasses.replace(self, supplied=frozenset(fixed) | (self.supplied or frozenset()))

    def closed(self) -> Domain:
        """Return the same domain for the states that can be reached from the problem's `:init`."""
        return self if self.supplied is None else dataclasses.replace(self, supplied=None)

    def declared(self, name: str) -> x.Declaration | None:
        """Return the declaration of a ground predicate or function; None where there is none.

        Args:
            name: Name and objects, such as `door-open hall`.
        """
        symbol, *arguments = name.split() or [""]
        declaration = self.syntax.declarations.get(symbol)
        if declaration is None or declaration.reserved or symbol in self.syntax.derived:
            return None
        if len(arguments) != len(declaration.parameters):
            return None
        problem = self.problem_syntax
        objects = problem.objects if problem is not None else self.syntax.constants
        for argument, parameter in zip(arguments, declaration.parameters, strict=True):
            known = objects.get(argument)
            if known is None or not self.syntax.admits(parameter, known.type):
                return None
        return declaration

    @functools.cached_property
    def model(self) -> TransitionModel:
        """The transition model, with control period 1 (see `TransitionModel.replace`)."""
        return TransitionModel(
            instantiate(
                self.syntax,
                self.problem_syntax,
                supplied=self.supplied,
                max_ground_schemas=self.max_ground_schemas,
            )
        )


def problem_beside(domain_file: Path) -> Path:
    """Return the default problem file of a domain file: `<name>-problem.pddl` beside it."""
    return domain_file.with_name(f"{domain_file.stem}-problem.pddl")


def load_domain(
    domain_file: str | Path,
    problem_file: str | Path | None = None,
    *,
    observed: bool = False,
    max_ground_schemas: int | None = None,
) -> Domain:
    """Load a domain and, where there is one, its problem.

    Args:
        domain_file: The PDDL domain.
        problem_file: The PDDL problem; without it, `<name>-problem.pddl` beside the domain file
            `<name>.pddl` is taken if it exists.
        observed: Whether states come from an environment. Otherwise they start from the problem's
            `:init`, and the model contains what can be reached from there.
        max_ground_schemas: Most ground actions, processes and events together; None: 200,000.

    Raises:
        DomainError: A file is missing, malformed, or uses what is not supported; the message
            has file, line, column, the line with a caret, and what to do.
    """
    source = Source.read(domain_file)
    if problem_file is None:
        sibling = problem_beside(Path(domain_file))
        problem_file = sibling if sibling.is_file() else None
    with contextlib.ExitStack() as afterwards:
        if gc.isenabled():  # a large file is millions of objects, and none is garbage
            gc.disable()
            afterwards.callback(gc.enable)
        domain = Domain.parse(
            source,
            Source.read(problem_file) if problem_file is not None else None,
            observed=observed,
            max_ground_schemas=max_ground_schemas,
        )
        domain.model  # noqa: B018  (instantiated now, so that every error is raised here)
    return domain
