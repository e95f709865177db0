"""Relaxed reachability: which instances can ever apply, and what they can change.

Every ground predicate and function is either constant or free to have any value. An instance can
apply where the constants do not refute its precondition; what it changes is free from then on. The
least fixed point is found without trying every binding: positive atoms of a precondition are
joined, and a fact that becomes possible is joined with those known before it (semi-naive
evaluation, as in Helmert, "Concise finite-domain representations for PDDL planning tasks",
Artificial Intelligence 173, 2009, section 6). Constants that refute a literal are watched; other
conditions are tried again as long as constants become free.

Consider the states that agree with the initial state on everything that is not free. No step leaves
them, and on them the smaller model is exact. Comparisons of numbers refute nothing, because the
numbers of a file may be adapted.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from serp.pddl import syntax as x
from serp.pddl.source import DomainError, Place

Binding = Mapping[str, str]
Key = tuple[str, ...]
"""A ground predicate or function: its name and the objects."""

MAX_GROUND_SCHEMAS = 200_000
BINDINGS_EACH = 20
"""Most bindings that are tried for each ground schema that there may be."""


class Facts:
    """The facts that the files state, and which of them may change.

    There are two kinds of worlds. In a *closed* one the states are those that can be reached from
    the problem's `:init`: only what an applicable instance changes may vary
    (`serp.model.reachability` computes it). In an *observed* one any state is possible: a fact is
    constant if `:init` states it, no effect changes it and no observation supplies it.

    `supplied` is None for a closed world, which needs a problem with an `:init`; else the names of
    the fluents that are known to be observed, such as `door-open hall`.

    A domain that is too large is refused: there may be `most` ground schemas.

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
        most: int,
    ) -> None:
        self.domain = domain
        self.most = most
        self.instances = self.bindings = 0
        self.objects = problem.objects if problem else domain.constants
        self.position = {name: k for k, name in enumerate(self.objects)}
        self.true: set[Key] = set()
        self.values: dict[Key, x.Number] = {}
        if problem:
            self.true = {key_of(a.name, a.arguments, {}) for a in problem.true_atoms}
            self.values = {key_of(f.name, f.arguments, {}): n for f, n in problem.values}
        self._members: dict[Sequence[str], Collection[str]] = {}
        self._names: dict[int, tuple[object, list[str]]] = {}
        self.closed = supplied is None and problem is not None and problem.has_init
        self.changed = x.changed_names(*(schema.effects for schema in domain.schemas))
        stated = {key[0] for key in itertools.chain(self.true, self.values)}
        declared = domain.declarations.values()
        if self.closed:
            names = {d.name for d in declared if d.numeric and d.name not in stated | self.changed}
        else:
            names = set(domain.declarations) - (stated - self.changed)
        names |= {d.name for d in declared if d.reserved}
        self.varying = frozenset(names)
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
                        self.check_fluents(len(self.free), declaration)

    def objects_of(self, types: Sequence[str]) -> Collection[str]:
        """Return the objects of any of the types, in the order of the files."""
        found = self._members.get(types)
        if found is None:
            parents, objects = self.domain.parents, self.objects.values()
            fits = {o.type: any(x.is_subtype(o.type, t, parents) for t in types) for o in objects}
            found = self._members[types] = dict.fromkeys(o.name for o in objects if fits[o.type])
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
            self.count_binding(place)
            yield {**binding, **dict(zip(names, chosen, strict=True))}

    def occurrence(self, part: object, binding: Binding) -> tuple[object, ...]:
        """Return what is equal where a part of the file means the same under two bindings."""
        if id(part) not in self._names:
            terms = (node for node in x.nodes_in(part) if isinstance(node, x.SchemaTerm))
            names = [*{term.name: None for term in terms if term.is_variable}]
            self._names[id(part)] = part, names  # kept, so that no other part gets its number
        return (id(part), *[binding.get(name) for name in self._names[id(part)][1]])

    # Limits -------------------------------------------------------------------------------------

    def count_binding(self, place: Place) -> None:
        """Count one binding of a variable."""
        self.bindings += 1
        if self.bindings > (limit := BINDINGS_EACH * self.most):
            raise _too_large(f"instantiation takes more than {limit} bindings", place)

    def count_instance(self, schema: x.Schema) -> None:
        """Count one ground action, process or event."""
        self.instances += 1
        if self.instances > self.most:
            bindings = math.prod(len(self.objects_of(p.types)) for p in schema.parameters)
            raise _too_large(
                f"the domain instantiates to more than {self.most} ground actions, processes and "
                f"events; `{schema.name}` has up to {bindings} over these objects",
                schema.place,
            )

    def check_fluents(self, count: int, declaration: x.Declaration) -> None:
        """Check a number of fluents against the limit."""
        if count > self.most:
            problem = f"the domain has more than {self.most} fluents over these objects"
            raise _too_large(problem, declaration.place)


def _too_large(problem: str, place: Place) -> DomainError:
    return DomainError(
        problem,
        place,
        "use fewer objects, more specific types, fewer parameters and quantifiers, or static "
        "predicates in preconditions; or raise the limit: `load_domain(..., max_ground_schemas=N)` "
        "in Python",
        code="too-large",
    )


def bound(term: x.SchemaTerm, binding: Binding) -> str:
    """Return the object that a term stands for."""
    return binding.get(term.name, term.name)


def key_of(name: str, arguments: tuple[x.SchemaTerm, ...], binding: Binding) -> Key:
    """Return a ground predicate or function."""
    return (name, *[binding.get(term.name, term.name) for term in arguments])


def conjuncts(condition: x.Condition) -> Iterator[x.Condition]:
    """Yield the parts of a conjunction, however it is nested."""
    if isinstance(condition, x.Connective) and condition.operator == "and":
        for operand in condition.operands:
            yield from conjuncts(operand)
    else:
        yield condition


def reachable(facts: Facts) -> dict[str, list[Binding]]:
    """Return the instances that can apply, by schema; `facts.free` grows by what they change."""
    return _Reachability(facts).run()


@dataclass(frozen=True, eq=False)
class _Rule:
    """A schema with its precondition split by kind of condition.

    Attributes:
        schema: The schema.
        atoms: Predicates that have to hold and do not vary freely; they are joined.
        rest: Other conditions, which may become possible while others become free.
        members: Parameter → the objects that it may be.
        seen: The arguments of all instances met.
        instances: Those that can apply.
    """

    schema: x.Schema
    atoms: tuple[x.Atom, ...]
    rest: tuple[x.Condition, ...]
    members: Mapping[str, Collection[str]]
    seen: set[Key] = field(default_factory=set)
    instances: list[Key] = field(default_factory=list)


@dataclass(slots=True, eq=False)
class _Item:
    """Effects under conditions; with a rule, an instance of it."""

    conditions: tuple[x.Condition, ...]
    effects: tuple[x.Effect, ...]
    binding: Binding
    rule: _Rule | None = None


class _Reachability:
    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.rules = [self._rule(schema) for schema in facts.domain.schemas]
        self.users: dict[str, list[tuple[_Rule, x.Atom]]] = {}
        for rule in self.rules:
            for atom in rule.atoms:
                self.users.setdefault(atom.name, []).append((rule, atom))
        self.settled = facts.changed <= facts.varying
        self.any_effect_counts = any(map(_calculates, facts.domain.schemas))
        self.possible: set[Key] = set()
        self.index: dict[tuple[str, int, str], list[Key]] = {}
        self.watched: dict[Key, list[_Item]] = {}
        self.barred: list[_Item] = []
        self.applied: set[object] = set()
        self.certain: set[object] = set()
        self.freed: deque[Key] = deque()

    def run(self) -> dict[str, list[Binding]]:
        for key in self.facts.in_order(self.facts.true | self.facts.free):
            self._add(key)
        for rule in self.rules:
            self._join(rule, {}, rule.atoms)
        while self.freed:
            while self.freed:
                key = self.freed.popleft()
                self._join_with(key)
                for item in self.watched.pop(key, ()):
                    self._try(item)
            barred, self.barred = self.barred, []
            for item in barred:
                self._try(item)
        return {
            rule.schema.name: [
                dict(zip((p.name for p in rule.schema.parameters), key[1:], strict=True))
                for key in self.facts.in_order(rule.instances)
            ]
            for rule in self.rules
        }

    def _rule(self, schema: x.Schema) -> _Rule:
        parts = [*conjuncts(schema.precondition)]
        anyhow = self.facts.varying | self.facts.domain.derived
        atoms = tuple(p for p in parts if isinstance(p, x.Atom) and p.name not in anyhow)
        rest = tuple(p for p in parts if not isinstance(p, x.Atom | x.NumericComparison))
        members = {p.name: self.facts.objects_of(p.types) for p in schema.parameters}
        return _Rule(schema, atoms, rest, members)

    # Joining -----------------------------------------------------------------------------------

    def _add(self, key: Key) -> None:
        self.possible.add(key)
        for place in _places(key):
            self.index.setdefault(place, []).append(key)

    def _join_with(self, key: Key) -> None:
        """Try every instance that has a fact among its atoms."""
        if key in self.possible:
            return
        self._add(key)
        for rule, atom in self.users.get(key[0], ()):
            binding = self._unified(rule, atom, key, {})
            if binding is not None:
                self._join(rule, binding, tuple(a for a in rule.atoms if a is not atom))

    def _join(self, rule: _Rule, binding: Binding, atoms: tuple[x.Atom, ...]) -> None:
        """Try every instance that extends a binding and has its atoms among the facts."""
        tables: list[tuple[x.Atom, Sequence[Key]]] = []
        for atom in atoms:
            if all(t.name in binding or not t.is_variable for t in atom.arguments):
                if key_of(atom.name, atom.arguments, binding) not in self.possible:
                    return
            else:
                tables.append((atom, self._candidates(atom, binding)))
        if tables:
            best, table = min(tables, key=lambda pair: len(pair[1]))
            others = tuple(atom for atom, _ in tables if atom is not best)
            for fact in table:
                self.facts.count_binding(rule.schema.place)
                extended = self._unified(rule, best, fact, binding)
                if extended is not None:
                    self._join(rule, extended, others)
            return
        for parameter, members in rule.members.items():
            if parameter not in binding:
                for name in members:
                    self.facts.count_binding(rule.schema.place)
                    self._join(rule, {**binding, parameter: name}, ())
                return
        instance = (rule.schema.name, *[binding[parameter] for parameter in rule.members])
        if instance not in rule.seen:
            rule.seen.add(instance)
            self._try(_Item(rule.rest, rule.schema.effects, binding, rule))

    def _candidates(self, atom: x.Atom, binding: Binding) -> Sequence[Key]:
        """Return a superset of the facts that match the atom under the binding so far."""
        pattern = [binding.get(t.name, None if t.is_variable else t.name) for t in atom.arguments]
        return min(
            (
                self.index.get((atom.name, i, name), ())
                for i, name in enumerate(pattern)
                if name is not None
            ),
            key=len,
            default=self.index.get((atom.name, -1, ""), ()),
        )

    def _unified(self, rule: _Rule, atom: x.Atom, fact: Key, binding: Binding) -> Binding | None:
        """Return the binding that unifies an atom with a fact; None where there is none."""
        extended = dict(binding)
        for term, name in zip(atom.arguments, fact[1:], strict=True):
            meant = extended.get(term.name)
            if meant is None and name in rule.members.get(term.name, (term.name,)):
                extended[term.name] = name
            elif meant != name:
                return None
        return extended

    # Applying ----------------------------------------------------------------------------------

    def _try(self, item: _Item) -> None:
        """Apply effects if their conditions can hold; else keep them, to be tried again.

        What a literal bars waits for its constant. Other conditions are tried whenever constants
        become free.
        """
        for condition in item.conditions:
            if self._possible(condition, item.binding, True):
                continue
            match condition:
                case x.Atom(name, terms) | x.Connective("not", (x.Atom(name, terms),)):
                    key = key_of(name, terms, item.binding)
                    self.watched.setdefault(key, []).append(item)
                case _:
                    self.barred.append(item)
            return
        if item.rule is not None:
            self.facts.count_instance(item.rule.schema)
            arguments = [item.binding[parameter] for parameter in item.rule.members]
            item.rule.instances.append((item.rule.schema.name, *arguments))
        if not self.settled:
            self._apply(item.effects, item.binding)

    def _apply(self, effects: tuple[x.Effect, ...], binding: Binding) -> None:
        for effect in effects:
            if isinstance(effect, x.When | x.ForallEffect):  # other instances may share it
                occurrence = self.facts.occurrence(effect, binding)
                if occurrence in self.applied:
                    continue
                self.applied.add(occurrence)
            match effect:
                case x.SetPredicate(atom, value):
                    key = key_of(atom.name, atom.arguments, binding)
                    if self.any_effect_counts or value != (key in self.facts.true):
                        self._free(key)
                case x.ChangeFunction(_, function):
                    self._free(key_of(function.name, function.arguments, binding))
                case x.When(condition, inner):
                    self._try(_Item((condition,), inner, binding))
                case x.ForallEffect(parameters, inner, place):
                    for more in self.facts.quantify(parameters, binding, place):
                        self._apply(inner, more)
                case x.Chance(outcomes):
                    for outcome in outcomes:
                        self._apply(outcome.effects, binding)

    def _free(self, key: Key) -> None:
        facts = self.facts
        if not facts.varies(key):
            facts.free.add(key)
            self.freed.append(key)
            facts.check_fluents(len(facts.free), facts.domain.declarations[key[0]])

    # Conditions --------------------------------------------------------------------------------

    def _possible(self, condition: x.Condition, binding: Binding, wanted: bool) -> bool:
        """Whether a condition can have the wanted truth value, as far as constants decide it."""
        match condition:
            case x.Atom(name) if name in self.facts.domain.derived:
                return True
            case x.Atom(name, arguments):
                key = key_of(name, arguments, binding)
                return self.facts.varies(key) or (key in self.facts.true) == wanted
            case x.SameObject(left, right):
                return (bound(left, binding) == bound(right, binding)) == wanted
            case x.NumericComparison():
                return True
            case x.Connective("not", (operand,)):
                return self._possible(operand, binding, not wanted)
            case x.Connective("imply", (premise, conclusion)):
                sides = ((premise, not wanted), (conclusion, wanted))
                parts = (self._possible(c, binding, w) for c, w in sides)
                return any(parts) if wanted else all(parts)
            case x.Connective(operator, operands):
                parts = (self._possible(c, binding, wanted) for c in operands)
                return all(parts) if (operator == "and") == wanted else any(parts)
            case x.Quantified(operator, parameters, body, place):
                occurrence = wanted, self.facts.occurrence(condition, binding)
                if occurrence in self.certain:
                    return True
                bindings = self.facts.quantify(parameters, binding, place)
                parts = (self._possible(body, inner, wanted) for inner in bindings)
                possible = all(parts) if (operator == "forall") == wanted else any(parts)
                if possible:  # from then on
                    self.certain.add(occurrence)
                return possible


def _places(key: Key) -> Iterator[tuple[str, int, str]]:
    """Yield the index keys of a fact: its name, and its name with each of its objects."""
    yield key[0], -1, ""
    for index, name in enumerate(key[1:]):
        yield key[0], index, name


def _calculates(schema: x.Schema) -> bool:
    """Whether the condition of an effect contains arithmetic, so that it may have no result."""
    return any(
        isinstance(part, x.Arithmetic)
        for effect in x.nodes_in(schema.effects)
        if isinstance(effect, x.When)
        for part in x.nodes_in(effect.condition)
    )
