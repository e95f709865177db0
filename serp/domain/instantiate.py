"""Instantiation: schemas over objects → ground actions, processes and events.

What the problem's `:init` states and no effect changes is *static*: it is a constant, prunes the
bindings of parameters while they are enumerated, and takes no column of the state. Every other
ground predicate and function is a fluent.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence

from serp.domain import ground as g
from serp.domain import syntax as x
from serp.domain.source import DomainError, Place

Binding = Mapping[str, str]
Key = tuple[str, ...]

MAX_GROUND_SCHEMAS = 20_000
MAX_FLUENTS = 200_000
MAX_EXPANSION = 300_000
_FLAGS = {x.UNSAFE: g.UNSAFE_TARGET, x.TERMINAL: g.TERMINAL_TARGET}
_TRUE = g.Constant(True)


def instantiate(
    domain: x.DomainSyntax,
    problem: x.ProblemSyntax | None = None,
    *,
    max_ground_schemas: int = MAX_GROUND_SCHEMAS,
) -> g.GroundModel:
    """Instantiate a domain over the objects of its problem (or over its constants).

    Args:
        domain: The parsed domain.
        problem: The parsed problem, if there is one.
        max_ground_schemas: Most ground actions, processes and events together.

    Raises:
        DomainError: There are more instances or fluents than the limits allow, or the metric
            contradicts `(reward)`.
    """
    return _Instantiation(domain, problem, max_ground_schemas).run()


class _Instantiation:
    def __init__(
        self, domain: x.DomainSyntax, problem: x.ProblemSyntax | None, max_ground_schemas: int
    ) -> None:
        self.domain = domain
        self.problem = problem
        self.limit = max_ground_schemas
        self.objects = problem.objects if problem else domain.constants
        self.parameters: list[g.Parameter] = []
        self.parameter_at: dict[tuple[int, int], int] = {}
        self.work = 0
        self.true_keys: set[Key] = set()
        self.values: dict[Key, x.Number] = {}
        if problem:
            self.true_keys = {_key(a.name, a.arguments, {}) for a in problem.true_atoms}
            self.values = {_key(f.name, f.arguments, {}): n for f, n in problem.values}
        stated = {key[0] for key in itertools.chain(self.true_keys, self.values)}
        self.static = stated - _changed_names(domain)
        self.supported: dict[tuple[str, int, tuple[str | None, ...]], set[str]] = {}
        self.facts: dict[tuple[str, int, str], list[Key]] = {}
        for key in self.true_keys:
            if key[0] in self.static:
                for i, name in [(-1, ""), *enumerate(key[1:])]:
                    self.facts.setdefault((key[0], i, name), []).append(key)
        self.by_type = {
            t: tuple(o.name for o in self.objects.values() if domain.is_a(o.type, t))
            for t in [x.OBJECT, *domain.parents]
        }
        self.fluents = self._fluents()
        self.index = {(f.symbol, *f.arguments): f.index for f in self.fluents}

    def run(self) -> g.GroundModel:
        ground: dict[x.Kind, list[g.GroundSchema]] = {kind: [] for kind in x.Kind}
        total = 0
        for schema in self.domain.schemas:
            for instance in self._instances(schema):
                total += 1
                if total > self.limit:
                    raise DomainError(
                        f"the domain instantiates to more than {self.limit} ground actions, "
                        f"processes and events; `{schema.name}` alone has up to "
                        f"{self._bindings_count(schema)} over these objects",
                        schema.place,
                        "use fewer objects, more specific types, or static predicates in the "
                        "precondition; or raise max_ground_schemas",
                    )
                ground[schema.kind].append(instance)
        goal = self._goal()
        metric = self._metric()
        return g.GroundModel(
            fluents=self.fluents,
            parameters=tuple(self.parameters),
            actions=tuple(ground[x.Kind.ACTION]),
            processes=tuple(ground[x.Kind.PROCESS]),
            events=tuple(ground[x.Kind.EVENT]),
            goal=goal,
            goal_rewarded=goal is not None
            and metric is None
            and x.REWARD not in self.domain.declarations,
            metric=metric,
            initial=self._initial(),
            static=self._static_values(),
        )

    # Fluents -----------------------------------------------------------------------------------

    def _fluents(self) -> tuple[g.Fluent, ...]:
        fluents: list[g.Fluent] = []
        for declaration in self.domain.declarations.values():
            if declaration.name in (x.REWARD, x.UNSAFE, x.TERMINAL, *self.static):
                continue
            choices = [self._objects_of(p.types) for p in declaration.parameters]
            for arguments in itertools.product(*choices):
                if len(fluents) >= MAX_FLUENTS:
                    raise DomainError(
                        f"the domain has more than {MAX_FLUENTS} fluents over these objects",
                        declaration.place,
                        "use fewer objects, more specific types or fewer parameters",
                    )
                name = " ".join((declaration.name, *arguments))
                fluents.append(
                    g.Fluent(name, len(fluents), declaration.numeric, declaration.name, arguments)
                )
        return tuple(fluents)

    def _initial(self) -> tuple[float, ...] | None:
        if self.problem is None:
            return None
        initial: list[float] = []
        for fluent in self.fluents:
            key = (fluent.symbol, *fluent.arguments)
            if not fluent.numeric:
                initial.append(1.0 if key in self.true_keys else 0.0)
            elif key in self.values:
                initial.append(self.values[key].value)
            else:
                return None
        return tuple(initial)

    def _static_values(self) -> dict[str, float]:
        stated = {" ".join(key): 1.0 for key in self.true_keys if key[0] in self.static}
        stated.update(
            (" ".join(key), number.value)
            for key, number in self.values.items()
            if key[0] in self.static
        )
        return stated

    # Bindings ----------------------------------------------------------------------------------

    def _objects_of(self, types: Sequence[str]) -> tuple[str, ...]:
        if len(types) == 1:
            return self.by_type[types[0]]
        members = {name for t in types for name in self.by_type[t]}
        return tuple(name for name in self.objects if name in members)

    def _bindings_count(self, schema: x.Schema) -> int:
        count = 1
        for parameter in schema.parameters:
            count *= len(self._objects_of(parameter.types))
        return count

    def _instances(self, schema: x.Schema) -> Iterator[g.GroundSchema]:
        filters = self._filters(schema)
        static = [
            c
            for c in _conjuncts(schema.precondition)
            if isinstance(c, x.Atom) and c.name in self.static
        ]
        supports = [
            [a for a in static if any(t.name == p.name for t in a.arguments)]
            for p in schema.parameters
        ]
        for binding in self._bind(schema, filters, supports, 0, {}):
            instance = self._instance(schema, binding)
            if instance is not None:
                yield instance

    def _filters(self, schema: x.Schema) -> list[list[x.Condition]]:
        """Static conjuncts of the precondition, by how many parameters must be bound for them."""
        position = {p.name: i for i, p in enumerate(schema.parameters)}
        filters: list[list[x.Condition]] = [[] for _ in range(len(schema.parameters) + 1)]
        for conjunct in _conjuncts(schema.precondition):
            literal = conjunct
            while isinstance(literal, x.Connective) and literal.operator == "not":
                literal = literal.operands[0]
            if isinstance(literal, x.Atom) and literal.name in self.static:
                terms: tuple[x.Term, ...] = literal.arguments
            elif isinstance(literal, x.SameObject):
                terms = (literal.left, literal.right)
            else:
                continue
            needed = max((position[t.name] + 1 for t in terms if t.is_variable), default=0)
            filters[needed].append(conjunct)
        return filters

    def _bind(
        self,
        schema: x.Schema,
        filters: list[list[x.Condition]],
        supports: list[list[x.Atom]],
        depth: int,
        binding: Binding,
    ) -> Iterator[Binding]:
        if any(self._test(c, binding) == g.Constant(False) for c in filters[depth]):
            return
        if depth == len(schema.parameters):
            yield binding
            return
        parameter = schema.parameters[depth]
        names: Iterable[str] = self._objects_of(parameter.types)
        for atom in supports[depth]:
            allowed = self._supported(atom, parameter.name, binding)
            names = [name for name in names if name in allowed]
        for name in names:
            self._count_work(schema.place)
            yield from self._bind(
                schema, filters, supports, depth + 1, {**binding, parameter.name: name}
            )

    def _supported(self, atom: x.Atom, variable: str, binding: Binding) -> set[str]:
        """Return the objects with which a static atom, bound so far, can still be true."""
        at = next(i for i, t in enumerate(atom.arguments) if t.name == variable)
        pattern = tuple(binding.get(t.name) if t.is_variable else t.name for t in atom.arguments)
        known = self.supported.get((atom.name, at, pattern))
        if known is None:
            bound = [(i, name) for i, name in enumerate(pattern) if name is not None]
            facts = min(
                (self.facts.get((atom.name, i, name), []) for i, name in bound),
                key=len,
                default=self.facts.get((atom.name, -1, ""), []),
            )
            known = {f[at + 1] for f in facts if all(f[i + 1] == name for i, name in bound)}
            self.supported[atom.name, at, pattern] = known
        return known

    def _count_work(self, place: Place) -> None:
        self.work += 1
        if self.work > MAX_EXPANSION:
            raise DomainError(
                f"instantiation takes more than {MAX_EXPANSION} bindings",
                place,
                "use fewer objects, more specific types, or fewer parameters and quantifiers",
            )

    def _instance(self, schema: x.Schema, binding: Binding) -> g.GroundSchema | None:
        preconditions: list[g.Test] = []
        if schema.precondition is not None:
            test = self._test(schema.precondition, binding)
            if isinstance(test, g.Constant):
                if not test.value:
                    return None
            elif isinstance(test, g.All):
                preconditions.extend(test.operands)
            else:
                preconditions.append(test)
        role = "rate" if schema.kind is x.Kind.PROCESS else "effect"
        effects = tuple(self._effects(schema.effects, binding, _TRUE, role))
        arguments = tuple(binding[p.name] for p in schema.parameters)
        return g.GroundSchema(
            kind=schema.kind,
            name=" ".join((schema.name, *arguments)),
            schema=schema.name,
            arguments=arguments,
            preconditions=tuple(preconditions),
            effects=effects,
            place=schema.place,
        )

    # Expressions -------------------------------------------------------------------------------

    def _literal(self, number: x.Number, role: str) -> g.Literal:
        at = (id(number.place.source), number.place.start)
        index = self.parameter_at.setdefault(at, len(self.parameters))
        if index == len(self.parameters):
            self.parameters.append(g.Parameter(index, number.value, role, number.place))
        return g.Literal(index)

    def _value(self, expression: x.Expression, binding: Binding, role: str) -> g.Value:
        match expression:
            case x.Number():
                return self._literal(expression, role)
            case x.FunctionTerm(name, arguments, place):
                key = _key(name, arguments, binding)
                if key in self.index:
                    return g.Read(self.index[key])
                if key not in self.values:
                    raise DomainError(
                        f"`({' '.join(key)})` has no value",
                        place,
                        f"the problem gives values to other instances of `{name}`; add "
                        f"`(= ({' '.join(key)}) ...)` to its :init",
                    )
                return self._literal(self.values[key], "initial")
            case x.TotalTime():
                return g.Elapsed()
            case x.Arithmetic(operator, operands, _):
                values = [self._value(operand, binding, role) for operand in operands]
                if len(values) == 1:
                    return g.Negation(values[0])
                result = values[0]
                for value in values[1:]:
                    result = g.Operation(operator, result, value)
                return result

    def _test(self, condition: x.Condition, binding: Binding) -> g.Test:
        match condition:
            case x.Atom(name, arguments, place):
                if name in _FLAGS:
                    return g.Holds(_FLAGS[name], place)
                key = _key(name, arguments, binding)
                if key in self.index:
                    return g.Holds(self.index[key], place)
                return g.Constant(key in self.true_keys)
            case x.SameObject(left, right, _):
                return g.Constant(_bound(left, binding) == _bound(right, binding))
            case x.Comparison(operator, left, right, place):
                return g.Compare(
                    operator,
                    self._value(left, binding, "condition"),
                    self._value(right, binding, "condition"),
                    place,
                )
            case x.Connective(operator, operands, place):
                return self._connective(operator, operands, place, binding)
            case x.Quantified(operator, parameters, body, place):
                tests = (
                    self._test(body, inner) for inner in self._quantify(parameters, binding, place)
                )
                return _join(tests, place, conjunction=operator == "forall")

    def _connective(
        self, operator: str, operands: tuple[x.Condition, ...], place: Place, binding: Binding
    ) -> g.Test:
        tests = (self._test(operand, binding) for operand in operands)
        if operator == "not":
            return _negate(next(tests), place)
        if operator == "imply":
            premise = _negate(next(tests), place)
            return _join(itertools.chain([premise], tests), place, conjunction=False)
        return _join(tests, place, conjunction=operator == "and")

    def _quantify(
        self, parameters: tuple[x.Parameter, ...], binding: Binding, place: Place
    ) -> Iterator[Binding]:
        names = [p.name for p in parameters]
        for chosen in itertools.product(*(self._objects_of(p.types) for p in parameters)):
            self._count_work(place)
            yield {**binding, **dict(zip(names, chosen, strict=True))}

    # Effects -----------------------------------------------------------------------------------

    def _effects(
        self, effects: tuple[x.Effect, ...], binding: Binding, condition: g.Test, role: str
    ) -> Iterator[g.GroundEffect]:
        for effect in effects:
            match effect:
                case x.SetPredicate(atom, value, place):
                    key = _key(atom.name, atom.arguments, binding)
                    target = _FLAGS.get(atom.name)
                    target = self.index[key] if target is None else target
                    yield g.SetBoolean(target, value, condition, place)
                case x.ChangeFunction(change, function, value, place):
                    key = _key(function.name, function.arguments, binding)
                    target = g.REWARD_TARGET if function.name == x.REWARD else self.index[key]
                    yield g.SetNumber(
                        target, change, self._value(value, binding, role), condition, place
                    )
                case x.When(test, inner, place):
                    joined = _join(
                        [condition, self._test(test, binding)], test.place, conjunction=True
                    )
                    if joined != g.Constant(False):
                        yield from self._effects(inner, binding, joined, role)
                case x.ForallEffect(parameters, inner, place):
                    for extended in self._quantify(parameters, binding, place):
                        yield from self._effects(inner, extended, condition, role)

    # Problem -----------------------------------------------------------------------------------

    def _goal(self) -> g.Test | None:
        goal = self.problem.goal if self.problem else None
        if goal is None or not any(_conjuncts(goal)):  # `()`, `(and)`: a task without a goal
            return None
        return self._test(goal, {})

    def _metric(self) -> g.GroundMetric | None:
        metric = self.problem.metric if self.problem else None
        if metric is None:
            return None
        expression = metric.expression
        if isinstance(expression, x.FunctionTerm) and expression.name == x.REWARD:
            if not metric.maximize:
                raise DomainError("`(reward)` is maximized, never minimized", metric.place)
            return None
        if x.REWARD in self.domain.declarations:
            raise DomainError(
                "the domain declares `(reward)`, so the metric can only be "
                "`(:metric maximize (reward))`",
                metric.place,
            )
        return g.GroundMetric(metric.maximize, self._value(expression, {}, "metric"), metric.place)


def _bound(term: x.Term, binding: Binding) -> str:
    return binding[term.name] if term.is_variable else term.name


def _key(name: str, arguments: tuple[x.Term, ...], binding: Binding) -> Key:
    return (name, *(_bound(term, binding) for term in arguments))


def _conjuncts(condition: x.Condition | None) -> Iterator[x.Condition]:
    if isinstance(condition, x.Connective) and condition.operator == "and":
        for operand in condition.operands:
            yield from _conjuncts(operand)
    elif condition is not None:
        yield condition


def _changed_names(domain: x.DomainSyntax) -> set[str]:
    names: set[str] = set()

    def collect(effects: tuple[x.Effect, ...]) -> None:
        for effect in effects:
            match effect:
                case x.SetPredicate(atom):
                    names.add(atom.name)
                case x.ChangeFunction(_, function):
                    names.add(function.name)
                case x.When(_, inner) | x.ForallEffect(_, inner):
                    collect(inner)

    for schema in domain.schemas:
        collect(schema.effects)
    return names


def _negate(test: g.Test, place: Place) -> g.Test:
    if isinstance(test, g.Constant):
        return g.Constant(not test.value)
    if isinstance(test, g.Not):
        return test.operand
    return g.Not(test, place)


def _join(tests: Iterable[g.Test], place: Place, *, conjunction: bool) -> g.Test:
    """Join tests, flattening the same connective and resolving constants.

    Tests after one that decides are not looked at: a distance needs no value where no road is.
    """
    flat: list[g.Test] = []
    same = g.All if conjunction else g.AnyOf
    for test in tests:
        if isinstance(test, g.Constant):
            if test.value != conjunction:  # false in a conjunction, true in a disjunction: decides
                return g.Constant(test.value)
            continue
        if isinstance(test, same):
            flat.extend(test.operands)
        else:
            flat.append(test)
    if not flat:
        return g.Constant(conjunction)
    if len(flat) == 1:
        return flat[0]
    return same(tuple(flat), place)
