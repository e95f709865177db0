"""The facts that the files state, and which ground predicates and functions may vary."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence

from serp.pddl import syntax as x
from serp.pddl.source import DomainError, Place

Binding = Mapping[str, str]
Key = tuple[str, ...]
"""A ground predicate or function: its name and the objects."""

MAX_GROUND_SCHEMAS = 50_000
_FLUENTS_EACH = 4
_BINDINGS_EACH = 20
_RAISE = (
    "or raise the limit: `--max-ground-schemas N` on the command line, in Python "
    "`load_domain(..., max_ground_schemas=N)`"
)


class InstantiationBudget:
    """Limits on the size of a domain, and counters of what instantiation produces.

    Attributes:
        ground_schemas: Most ground actions, processes and events together.
        fluents: Most fluents, four times as many.
        bindings: Most bindings that are tried, 20 times as many.
    """

    def __init__(self, ground_schemas: int = MAX_GROUND_SCHEMAS) -> None:
        self.ground_schemas = ground_schemas
        self.fluents = _FLUENTS_EACH * ground_schemas
        self.bindings = _BINDINGS_EACH * ground_schemas
        self.instances = 0
        self.work = 0

    def count_binding(self, place: Place) -> None:
        """Count one binding of a variable."""
        self.work += 1
        if self.work > self.bindings:
            raise DomainError(
                f"instantiation takes more than {self.bindings} bindings",
                place,
                "use fewer objects, more specific types, or fewer parameters and quantifiers; "
                + _RAISE,
                code="too-large",
            )

    def count_instance(self, schema: x.Schema, facts: Facts) -> None:
        """Count one ground action, process or event."""
        self.instances += 1
        if self.instances > self.ground_schemas:
            bindings = math.prod(len(facts.objects_of(p.types)) for p in schema.parameters)
            raise DomainError(
                f"the domain instantiates to more than {self.ground_schemas} ground actions, "
                f"processes and events; `{schema.name}` has up to {bindings} over these objects",
                schema.place,
                "use fewer objects, more specific types, or static predicates in the "
                f"precondition; {_RAISE}",
                code="too-large",
            )

    def check_fluents(self, count: int, declaration: x.Declaration) -> None:
        """Check a number of fluents against the limit."""
        if count > self.fluents:
            raise DomainError(
                f"the domain has more than {self.fluents} fluents over these objects",
                declaration.place,
                f"use fewer objects, more specific types or fewer parameters; {_RAISE}",
                code="too-large",
            )


def no_value(key: tuple[str, ...], read: Place, place: Place) -> DomainError:
    """Return the error of a static number that is read and that the problem does not give."""
    shown = " ".join(key)
    return DomainError(
        f"`({shown})` has no value, but `{read}` reads it",
        place.opening,
        f"the problem gives values to other instances of `{key[0]}`; add "
        f"`(= ({shown}) ...)` to its :init",
        code="missing-value",
    )


class Facts:
    """The facts that the files state, and which of them may change.

    There are two kinds of worlds. In a *closed* one the states are those that can be reached from
    the problem's `:init`: only what an applicable instance changes may vary
    (`serp.model.reachability` computes it). In an *observed* one any state is possible: a fact is
    constant if `:init` states it, no effect changes it and no observation supplies it.

    `supplied` is None for a closed world, which needs a problem with an `:init`; else the names of
    the fluents that are known to be observed, such as `door-open hall`.

    Attributes:
        objects: All objects.
        true: The predicates that hold at the start.
        values: The numbers at the start.
        closed: Whether the world is closed.
        varying: Names of which every instance may vary.
        free: Ground predicates and functions found to vary so far.
        changed: Names that some effect changes.
    """

    def __init__(
        self,
        domain: x.DomainSyntax,
        problem: x.ProblemSyntax | None,
        supplied: Collection[str] | None,
        budget: InstantiationBudget,
    ) -> None:
        self.domain = domain
        self.budget = budget
        self.objects = problem.objects if problem else domain.constants
        self.position = {name: k for k, name in enumerate(self.objects)}
        self.true: set[Key] = set()
        self.values: dict[Key, x.Number] = {}
        if problem:
            self.true = {key_of(a.name, a.arguments, {}) for a in problem.true_atoms}
            self.values = {key_of(f.name, f.arguments, {}): n for f, n in problem.values}
        self._members: dict[Sequence[str], Collection[str]] = {}
        self.closed = supplied is None and problem is not None and problem.has_init
        self.changed = _changed_names(domain)
        stated = {key[0] for key in itertools.chain(self.true, self.values)}
        declared = domain.declarations.values()
        if self.closed:
            names = {d.name for d in declared if d.numeric and d.name not in stated | self.changed}
        else:
            names = set(domain.declarations) - (stated - self.changed)
        self.varying = frozenset(names | {x.REWARD, x.UNSAFE, x.TERMINAL})
        self.free = {tuple(name.split()) for name in supplied or ()}

    def varies(self, key: Key) -> bool:
        """Whether a ground predicate or function may differ from its value at the start."""
        return key[0] in self.varying or key in self.free

    def free_missing_numbers(self) -> None:
        """Let functions vary that have effects but no value in `:init`; they start at 0."""
        for declaration in self.domain.declarations.values():
            if declaration.numeric and declaration.name in self.changed - self.varying:
                for key in self.keys_of(declaration):
                    if key not in self.values:
                        self.free.add(key)
                        self.budget.check_fluents(len(self.free), declaration)

    def objects_of(self, types: Sequence[str]) -> Collection[str]:
        """Return the objects of any of the types, in the order of the files."""
        found = self._members.get(types)
        if found is None:
            is_a, objects = self.domain.is_a, self.objects.values()
            names = (o.name for o in objects if any(is_a(o.type, t) for t in types))
            found = self._members[types] = dict.fromkeys(names)
        return found

    def keys_of(self, declaration: x.Declaration) -> Iterator[Key]:
        """Yield every instance of a declaration, in the order of the files."""
        choices = [self.objects_of(p.types) for p in declaration.parameters]
        for arguments in itertools.product(*choices):
            yield (declaration.name, *arguments)

    def in_order(self, keys: Collection[Key]) -> list[Key]:
        """Sort tuples of a name and objects as `keys_of` yields them."""
        position = self.position
        return sorted(keys, key=lambda key: [position[name] for name in key[1:]])

    def quantify(
        self, parameters: tuple[x.SchemaParameter, ...], binding: Binding, place: Place
    ) -> Iterator[Binding]:
        """Yield the binding, extended by every choice of objects for the parameters."""
        names = [p.name for p in parameters]
        for chosen in itertools.product(*(self.objects_of(p.types) for p in parameters)):
            self.budget.count_binding(place)
            yield {**binding, **dict(zip(names, chosen, strict=True))}


def bound(term: x.SchemaTerm, binding: Binding) -> str:
    """Return the object that a term stands for."""
    return binding[term.name] if term.is_variable else term.name


def key_of(name: str, arguments: tuple[x.SchemaTerm, ...], binding: Binding) -> Key:
    """Return a ground predicate or function."""
    return (name, *(bound(term, binding) for term in arguments))


def conjuncts(condition: x.Condition | None) -> Iterator[x.Condition]:
    """Yield the parts of a conjunction, however it is nested."""
    if isinstance(condition, x.Connective) and condition.operator == "and":
        for operand in condition.operands:
            yield from conjuncts(operand)
    elif condition is not None:
        yield condition


def _changed_names(domain: x.DomainSyntax) -> set[str]:
    names: set[str] = set()
    for schema in domain.schemas:
        for effect in x.nested_effects(schema.effects):
            if isinstance(effect, x.SetPredicate):
                names.add(effect.atom.name)
            elif isinstance(effect, x.ChangeFunction):
                names.add(effect.function.name)
    return names
