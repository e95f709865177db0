"""Writing small random domains and problems as PDDL text.

Everything is drawn from a `random.Random`, so that hypothesis can drive (and shrink) it through
`st.randoms()` and a plain seed can too. Numbers are quarters, so that arithmetic on them is exact.
"""

from dataclasses import dataclass, field
from random import Random

Types = tuple[str, ...]

# Names that would mean something, were they ever to reach program text.
_TRAPS = ("class", "lambda", "import", "s", "a", "n", "theta", "dt", "out", "t0", "kind0", "trace")


FULL, PLANNABLE = False, True
"""Everything that serp supports; the same with `(reward)`, `(unsafe)` and `(terminal)` always."""


@dataclass(frozen=True)
class Texts:
    """A domain and, where there is one, its problem."""

    domain: str
    problem: str | None

    def __str__(self):
        return self.domain + ("\n" + self.problem if self.problem else "")


@dataclass(frozen=True)
class _Symbol:
    name: str
    parameters: tuple[Types, ...]
    changes: bool


@dataclass
class _Writer:
    random: Random
    rewarding: bool
    parents: dict[str, str] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)
    predicates: list[_Symbol] = field(default_factory=list)
    functions: list[_Symbol] = field(default_factory=list)
    reserved: frozenset[str] = frozenset()
    fresh: int = 0
    together: list[dict[str, str]] = field(default_factory=list)
    """How the effects that happen together change each function, innermost scope last."""

    # Chance ------------------------------------------------------------------------------------

    def maybe(self, percent):
        return self.random.randint(1, 100) > 100 - percent

    def number(self):
        return f"{self.random.randint(-12, 12) / 4:g}"

    def effects(self, most, variables, inside=()):
        """Effects that happen together; none that could never do so."""
        self.together.append({})
        written = self.some(1, most, lambda: self.effect(variables, inside))
        self.together.pop()
        return written

    def some(self, least, most, write):
        written = [write() for _ in range(self.random.randint(least, most))]
        return [text for text in written if text is not None]

    # Declarations ------------------------------------------------------------------------------

    def write(self):
        has_problem = self.maybe(70)
        for name in ("room", "hall", "robot", "tool")[: self.random.randint(0, 4)]:
            self.parents[name] = self.random.choice(self.known_types())
        names = [f"o{k}" for k in range(self.random.randint(1, 4))]
        for name in names:
            group = self.objects if has_problem and self.maybe(60) else self.constants
            group[name] = self.random.choice(self.known_types())
        self.predicates = self.symbols("p", _TRAPS[:6])
        self.functions = self.symbols("f", _TRAPS[6:])
        self.reserved = frozenset(
            name for name in ("reward", "unsafe", "terminal") if self.rewarding or self.maybe(60)
        )
        schemas = [self.schema("action", k) for k in range(self.random.randint(1, 3))]
        schemas += [self.schema("process", k) for k in range(self.random.randint(0, 2))]
        schemas += [self.schema("event", k) for k in range(self.random.randint(0, 3))]
        # The domain speaks of constants alone; what follows may name every object.
        self.constants.update(self.objects)
        return Texts(self.domain(schemas), self.problem() if has_problem else None)

    def symbols(self, prefix, traps):
        names = [f"{prefix}{k}" for k in range(self.random.randint(1, 3))]
        if self.maybe(30):
            names[0] = self.random.choice(traps)
        return [
            _Symbol(
                name,
                tuple(self.types() for _ in range(self.random.choice((0, 0, 1, 1, 2)))),
                self.maybe(75),
            )
            for name in names
        ]

    def known_types(self):
        return [*self.parents, "object"]

    def types(self):
        known = self.known_types()
        if len(known) > 2 and self.maybe(10):
            return tuple(known[:2])
        return (self.random.choice(known),)

    def domain(self, schemas):
        types = " ".join(f"{name} - {parent}" for name, parent in self.parents.items())
        constants = {name: t for name, t in self.constants.items() if name not in self.objects}
        flags = [f"({name})" for name in ("unsafe", "terminal") if name in self.reserved]
        reward = ["(reward)"] if "reward" in self.reserved else []
        lines = [
            "(define (domain generated)",
            "  (:requirements :math-functions)",
            f"  (:types {types})" if types else "",
            f"  (:constants {_typed(constants)})" if constants else "",
            f"  (:predicates {' '.join([*map(_declared, self.predicates), *flags])})",
            f"  (:functions {' '.join([*map(_declared, self.functions), *reward])})",
            *schemas,
        ]
        return "\n".join(line for line in lines if line) + ")\n"

    # Schemas -----------------------------------------------------------------------------------

    def schema(self, kind, k):
        variables = {f"?v{i}": self.types() for i in range(self.random.choice((0, 1, 1, 2)))}
        conditions = self.some(0, 2, lambda: self.condition(variables, 2))
        if kind == "process":
            effects = self.some(1, 2, lambda: self.flow(variables))
        else:
            effects = self.effects(4, variables)
        return (
            f"  (:{kind} {kind}{k}\n"
            f"    :parameters ({_variables(variables)})\n"
            f"    :precondition (and {' '.join(conditions)})\n"
            f"    :effect (and {' '.join(effects)}))"
        )

    # Terms -------------------------------------------------------------------------------------

    def is_a(self, name, wanted):
        while name not in wanted and name != "object":
            name = self.parents[name]
        return name in wanted

    def term(self, wanted, variables):
        fitting = [v for v, own in variables.items() if all(self.is_a(t, wanted) for t in own)]
        fitting += [o for o, own in self.constants.items() if self.is_a(own, wanted)]
        return self.random.choice(fitting) if fitting else None

    def applied(self, symbols, variables):
        if not symbols:
            return None
        symbol = self.random.choice(symbols)
        terms = [self.term(wanted, variables) for wanted in symbol.parameters]
        return None if None in terms else f"({' '.join([symbol.name, *map(str, terms)])})"

    def quantified(self, variables):
        self.fresh += 1
        name, own = f"?w{self.fresh}", self.types()
        return _variables({name: own}), {**variables, name: own}

    # Conditions --------------------------------------------------------------------------------

    def condition(self, variables, depth):
        kind = self.random.randint(0, 9 if depth else 4)
        if kind <= 2:
            return self.atom(variables)
        if kind == 3:
            operator = self.random.choice(("<", "<=", "=", ">=", ">"))
            left, right = self.value(variables, 1), self.value(variables, 1)
            if left[0] != "(":
                left = f"(+ {left} 0)"
            return f"({operator} {left} {right})"
        if kind == 4:
            own = self.types()
            left_term, right_term = self.term(own, variables), self.term(own, variables)
            if left_term is None or right_term is None:
                return "(and)"
            return f"(= {left_term} {right_term})"
        if kind == 5:
            return f"(not {self.condition(variables, depth - 1)})"
        if kind == 6:
            first, second = (self.condition(variables, depth - 1) for _ in range(2))
            return f"(imply {first} {second})"
        if kind == 7:
            operator = self.random.choice(("exists", "forall"))
            listed, inner = self.quantified(variables)
            return f"({operator} ({listed}) {self.condition(inner, depth - 1)})"
        parts = self.some(1, 3, lambda: self.condition(variables, depth - 1))
        return f"({self.random.choice(('and', 'or'))} {' '.join(parts)})"

    def atom(self, variables):
        flags = self.reserved - {"reward"}
        if flags and self.maybe(10):
            return f"({self.random.choice(sorted(flags))})"
        return self.applied(self.predicates, variables) or "(and)"

    # Numbers -----------------------------------------------------------------------------------

    def value(self, variables, depth):
        kind = self.random.randint(0, 8 if depth else 3)
        if kind <= 1:
            return self.number()
        if kind <= 3:
            return self.applied(self.functions, variables) or self.number()
        first, second = (self.value(variables, depth - 1) for _ in range(2))
        if kind == 5:
            return self.random.choice((f"(- {first})", f"(+ {first} {second} 1)"))
        if kind == 8:
            return self.function(first, second)
        operator = self.random.choice("+-*/")
        if operator == "/" and second == "0":
            operator = "*"
        return f"({operator} {first} {second})"

    def function(self, first, second):
        """A function of `:math-functions`; no root that is known to have no result."""
        name = self.random.choice(("sqrt", "abs", "sin", "cos", "atan2", "min", "max"))
        if name in ("min", "max") and self.maybe(30):
            return f"({name} {first} {second} {self.number()})"
        if name in ("atan2", "min", "max"):
            return f"({name} {first} {second})"
        return f"({name} {first.lstrip('-') if name == 'sqrt' else first})"

    # Effects -----------------------------------------------------------------------------------

    def effect(self, variables, inside=()):
        kind = self.random.randint(0, 9)
        if kind == 0 and "when" not in inside:
            condition = self.condition(variables, 1)
            parts = self.effects(2, variables, (*inside, "when"))
            return f"(when {condition} (and {' '.join(parts)}))"
        if kind == 1 and inside.count("forall") < 2:
            listed, inner = self.quantified(variables)
            parts = self.effects(2, inner, (*inside, "forall"))
            return f"(forall ({listed}) (and {' '.join(parts)}))"
        if kind <= 5:
            return self.setting(variables)
        return self.change(variables)

    def setting(self, variables):
        flags = self.reserved - {"reward"}
        if flags and self.maybe(30):
            return f"({self.random.choice(sorted(flags))})"
        atom = self.applied([p for p in self.predicates if p.changes], variables)
        return atom if atom is None or self.maybe(50) else f"(not {atom})"

    def change(self, variables):
        change = self.random.choice(("increase", "decrease"))
        if "reward" in self.reserved and self.maybe(40):
            return f"({change} (reward) {self.value(variables, 2)})"
        function = self.applied([f for f in self.functions if f.changes], variables)
        if function is None:
            return None
        kind = self.random.randint(0, 9)
        if kind <= 3:
            change = "assign"
        elif kind <= 5:
            change = self.random.choice(("scale-up", "scale-down"))
        value = self.value(variables, 2)
        group = {"increase": "sum", "decrease": "sum", "assign": "assign"}.get(change, "product")
        first = function not in self.together[-1]
        known = self.together[-1].setdefault(function, group)
        if known != group or (group == "assign" and value[0] != "(" and not first):
            return None
        return f"({change} {function} {value})"

    def flow(self, variables):
        if self.maybe(10):
            listed, inner = self.quantified(variables)
            return f"(forall ({listed}) (and {self.flow(inner) or ''}))"
        change = self.random.choice(("increase", "decrease"))
        function = self.applied([f for f in self.functions if f.changes], variables)
        if "reward" in self.reserved and self.maybe(30):
            function = "(reward)"
        if function is None:
            return None
        rate = self.value(variables, 2)
        return f"({change} {function} {self.random.choice((f'(* #t {rate})', f'(* {rate} #t)'))})"

    # Problem -----------------------------------------------------------------------------------

    def problem(self):
        facts = []
        for predicate in self.predicates:
            if predicate.changes or self.maybe(70):
                facts += [atom for atom in self.instances(predicate) if self.maybe(50)]
        valued = self.maybe(70)
        for function in self.functions:
            if valued:
                facts += [f"(= {term} {self.number()})" for term in self.instances(function)]
        if "reward" in self.reserved and self.maybe(20):
            facts.append("(= (reward) 0)")
        goal = f"(and {' '.join(self.some(0, 2, lambda: self.condition({}, 2)))})"
        metric = ""
        if "reward" not in self.reserved and self.maybe(40):
            sense = self.random.choice(("maximize", "minimize"))
            value = self.random.choice((self.value({}, 2), "(total-time)"))
            metric = f"\n  (:metric {sense} {value})"
        elif "reward" in self.reserved and self.maybe(30):
            metric = "\n  (:metric maximize (reward))"
        return (
            "(define (problem generated-problem)\n"
            "  (:domain generated)\n"
            f"  (:objects {_typed(self.objects)})\n"
            f"  (:init {' '.join(facts)})\n"
            f"  (:goal {goal}){metric})\n"
        )

    def instances(self, symbol):
        terms = [symbol.name]
        for wanted in symbol.parameters:
            fitting = [name for name, own in self.constants.items() if self.is_a(own, wanted)]
            terms = [f"{term} {name}" for term in terms for name in fitting]
        return [f"({term})" for term in terms]


def _typed(names):
    return " ".join(f"{name} - {own}" for name, own in names.items())


def _variables(variables):
    def written(own):
        return own[0] if len(own) == 1 else f"(either {' '.join(own)})"

    return " ".join(f"{name} - {written(own)}" for name, own in variables.items())


def _declared(symbol):
    variables = {f"?x{k}": own for k, own in enumerate(symbol.parameters)}
    return f"({symbol.name} {_variables(variables)})" if variables else f"({symbol.name})"


def write_texts(random, rewarding=FULL):
    """Write a domain and, mostly, a problem."""
    return _Writer(random, rewarding).write()
