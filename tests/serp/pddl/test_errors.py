"""What is wrong is refused where it stands, with what to do about it.

In the texts, `«` and `»` enclose the place that the message must name; they are taken out before
the text is read.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from serp.model.domain import load_domain
from serp.model.instantiate import instantiate
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import DomainError, Source
from tests.serp.pddl.rendering import caret_text, check_rendering

DOMAIN = """\
(define (domain robots)
  (:requirements :adl :numeric-fluents)
  (:types robot - mobile mobile place)
  (:constants home - place r2 - robot)
  (:predicates (at ?r - robot ?p - place) (open ?p - place) (tired) (unsafe) (terminal))
  (:functions (charge ?r - robot) (speed) (reward))
  %s)
"""
PROBLEM = """\
(define (problem errand)
  (:domain robots)
  (:objects hall - place)
  %s)
"""


def action(effect: str = "(tired)", precondition: str = "(and)") -> str:
    return DOMAIN % (
        f"(:action go :parameters (?r - robot ?p - place)\n    :precondition {precondition}"
        f"\n    :effect {effect})"
    )


def with_math(number: str) -> str:
    text = action(f"(increase (speed) {number})")
    return text.replace(":adl", ":adl :math-functions", 1)


def process(effect: str) -> str:
    return DOMAIN % f"(:process run :parameters () :precondition (and) :effect {effect})"


def problem(section: str) -> str:
    return PROBLEM % section


LONG = "\n 1" * 150


# fmt: off
IN_DOMAIN = {
    # Parentheses and words
    "closing first": ("«)»", "`)` without a `(`", ""),
    "no parentheses": ("«hello»", "text outside of parentheses", "begins with `(define`"),
    "too deep": ("(" * 100 + "«(»", "nested deeper than 100", ""),
    "odd space": ("(define«\u00a0»(domain d))", "U+00A0", "replace it with a space"),
    # The whole
    "empty define": ("«(define)»", "expected `(domain name)`", ""),
    "no name": ("(define «(domain)»)", "expected `(domain name)`", ""),
    "domain name": ("(define (domain «../d»))", "`../d` is not a name", "begin with a letter"),
    "unknown section": (DOMAIN % "(«:actoin» go)", "`:actoin` is not supported",
                        "did you mean `:action`?"),
    "durative action": (DOMAIN % "(«:durative-action» go)", "`:durative-action` is not supported",
                        "an action, and a process"),
    "section twice": (DOMAIN % "«(:types car)»", "a second `:types`", "merge the two"),
    "list as requirement": ("(define (domain d) (:requirements «(:typing)»))",
                            "expected a requirement", ""),
    # Types, objects, predicates, functions
    "type cycle": ("(define (domain d) (:types a - b «b» - c c - b))", "`b` is its own anc", ""),
    "object with parent": ("(define (domain d) (:types «object» - a))", "the root of all", ""),
    "two parents": ("(define (domain d) (:types «a» - (either b c)))", "a type has one parent", ""),
    "dash first": ("(define (domain d) (:predicates (p «-» a)))", "`- a` without a parameter", ""),
    "dash last": ("(define (domain d) (:types a «-»))", "`-` without a type after it", ""),
    "unknown type": ("(define (domain d) (:predicates (p ?x - «car»)))", "unknown type `car`",
                     "declare it: `(:types car)`"),
    "odd type list": ("(define (domain d) (:types a - «(both b c)»))", "expected a type or", ""),
    "object of two types": ("(define (domain d) (:types b c) (:constants «a» - (either b c)))",
                            "an object has one type", ""),
    "empty predicate": ("(define (domain d) (:predicates «()»))", "empty declaration", ""),
    "predicate and function": ("(define (domain d) (:predicates (p)) (:functions «(p)»))",
                               "both a predicate and a function", ""),
    "keyword as predicate": ("(define (domain d) (:predicates («when»)))", "a word of PDDL", ""),
    "parameter without ?": ("(define (domain d) (:predicates (p «x»)))",
                            "expected a variable", "begin with `?`"),
    "parameter twice": (
        "(define (domain d) (:types t) (:action go :parameters (?x - t «?x»)))",
        "parameter `?x` is declared twice", ""),
    "constraint": (DOMAIN % "(«:constraint» slow)", "`:constraint` is not supported", "`(unsafe)`"),
    "object fluent": ("(define (domain d) (:types t) (:functions (f) - «t»))",
                      "other than numbers", "write `- number`"),
    "unsafe as function": ("(define (domain d) (:functions «(unsafe)»))",
                           "reserved and must be a predicate", ""),
    "terminal of something": ("(define (domain d) (:predicates «(terminal ?x)»))",
                              "takes no parameters", ""),
    # Schemas
    "no schema name": (DOMAIN % "«(:action)»", "`:action` without a name", ""),
    "schema twice": (DOMAIN % "(:action go) (:event «go»)", "`go` is defined twice", "must differ"),
    "field twice": (DOMAIN % "(:action go :effect () «:effect» ())", "a second `:effect`", ""),
    "field without value": (DOMAIN % "(:action go «:effect»)", "`:effect` without a value", ""),
    # Conditions
    "unknown predicate": (action(precondition="(and («opne» ?p))"), "unknown predicate `opne`",
                          "did you mean `open`?"),
    "unknown variable": (action(precondition="(open «?q»)"), "unknown variable `?q`",
                         "known here: `?p`, `?r`; `:parameters`, `forall` and"),
    "unknown object": (action(precondition="(open «homr»)"), "unknown object `homr`",
                       "did you mean `home`?"),
    "list as argument": (action(precondition="(open «(home)»)"), "found a list", ""),
    "wrong type": (action(precondition="(open «?r»)"), "`?r` is of type `robot`, but", ""),
    "quantifier": (action(precondition="«(forall (?x - robot))»"), "a list of variables and one",
                   "write `(forall (?x - type) ...)`"),
    "preference": (action(precondition="«(preference a (tired))»"), "preferences", "(reward)"),
    "timed condition": (action(precondition="(and «(over all (tired))»)"), "timed conditions",
                        "a process"),
    # Numbers
    "argument without ()": (action("(increase (speed) «charge»)"), "expected a number", ""),
    "predicate as number": (action("(increase (speed) («tired»))"), "`tired` is a predicate", ""),
    "too large": (action("(increase (speed) «1e400»)"), "too large a number", ""),
    "one added": (action("(increase (speed) «(+ 1)»)"), "`+` takes two or more operands", ""),
    "math undeclared": (action("(increase (speed) («max» 1 2))"), "`max` is not PDDL: it needs the",
                        "for a portable one write an effect under `when`"),
    "the least of one": (with_math("«(min 1)»"), "`min` takes two or more operands", ""),
    "root of a negative": (with_math("(sqrt «-1»)"), "a root of a negative", "never has a result"),
    "reading the reward": (action("(increase (speed) «(reward)»)"), "cannot be read", ""),
    "time outside": (action("(increase (speed) (* «#t» 2))"), "factor of a rate in a process",
                     "(:process"),
    "total time": (action("(increase (speed) «(total-time)»)"), "only in a metric", ""),
    "endless sum": (action(f"(increase (speed) «(+{LONG})»)"), "more than 100", ""),
    # Effects
    "choice": (action("«(or (tired) (open ?p))»"), "`or` is not supported in an effect",
               "deterministic"),
    "nested when, deeper": (
        action("(when (tired) (forall (?x - robot) (and «(when (tired) (tired))»)))"),
        "`when` inside `when`", ""),
    "unsafe made false": (action("«(not (unsafe))»"), "can only be made true", "every step"),
    "reward assigned": (action("«(assign (reward) 1)»"), "only be increased or decreased", ""),
    "no value": (action("«(increase (speed))»"), "a function and a value", ""),
    "wrong type increased": (action("(increase (charge «?p») 1)"), "`?p` is of type `place`", ""),
    # Processes
    "rate without #t": (process("(increase (speed) «(speed)»)"), "rate times `#t`",
                        "write `(* #t (speed))`"),
    "assignment in a process": (process("«(assign (speed) #t)»"), "only increase or decrease", ""),
    "predicate in a process": (process("«(tired)»"), "only increases and decreases", "(:event"),
    "when in a process": (process("«(when (tired) (increase (speed) #t))»"),
                          "`when` is not supported in a process", "under :precondition"),
}

IN_PROBLEM = {
    "domain instead": ("(define «(domain d)»)", "this is a domain file", ""),
    "no domain name": (problem("").replace("(:domain robots)", "«(:domain)»"),
                       "expected `(:domain name)`", ""),
    "section twice": (problem("(:init) «(:init)»"), "a second `:init`", "merge"),
    "constraints": (problem("(«:constraints» (and))"), "`:constraints` is not supported",
                    "an event that sets `(unsafe)`"),
    "constant of another type": (problem("").replace("hall", "«home» - robot hall"),
                                 "`home` is a constant of type `place`", ""),
    "variable": (problem("(:init (open «?x»))"), "unknown variable `?x`", "no variable is bound"),
    "word as fact": (problem("(:init «tired»)"), "expected a fact in parentheses", ""),
    "compound fact": (problem("(:init «(and (tired))»)"), "expected a predicate over objects", ""),
    "negated number": (problem("(:init «(not (= (speed) 1))»)"), "`not` takes one predicate", ""),
    "true and false": (problem("(:init (tired) «(not (tired))»)"), "also stated true", ""),
    "flag": (problem("(:init «(unsafe)»)"), "starts false in every step", ""),
    "reward": (problem("(:init (= (reward) «5»))"), "starts at 0", ""),
    "two values": (problem("(:init (= (speed) 1) «(= (speed) 2)»)"), "a second value", ""),
    "expression as value": (problem("(:init (= (speed) «(+ 1 2)»))"), "expected a number", ""),
    "expression valued": (problem("(:init (= «(+ 1 2)» 3))"), "expected a function", ""),
    "value of two": (problem("(:init «(= (speed) 1 2)»)"), "expected `(= (function) number)`", ""),
    "timed literal": (problem("(:init «(at 5 (tired))»)"), "timed initial literals", "a clock"),
    "metric": (problem("«(:metric maximize)»"), "expected `(:metric", ""),
    "metric sense": (problem("(:metric «maximise» (reward))"), "expected maximize or minimize", ""),
    "metric beside reward": (problem("«(:metric minimize (speed))»"), "declares `(reward)`", ""),
    "reward minimized": (problem("«(:metric minimize (reward))»"), "never minimized", ""),
    "violations": (problem("(:metric minimize («is-violated» a))"), "unknown func", "known"),
}
# fmt: on


def marked(text: str) -> tuple[str, int, int, str]:
    """Take the marks out: the text, line and column of the place, and what is shown of it."""
    before, inside, after = re.fullmatch("([^«]*)«([^»]*)»([^»]*)", text, re.DOTALL).groups()  # type: ignore[union-attr]
    line = before.count("\n") + 1
    column = len(before.rsplit("\n", 1)[-1]) + 1
    return before + inside + after, line, column, inside.split("\n")[0]


def check(error: DomainError, file: str, text: str, says: str, advises: str) -> None:
    plain, line, column, shown = marked(text)
    assert (error.file, error.line, error.column) == (file, line, column), str(error)
    assert says in error.problem
    assert advises in error.advice
    assert error.source_line is not None
    check_rendering(error, plain)
    assert caret_text(error) == (shown if shown.isprintable() else " ")


@pytest.mark.parametrize("name", IN_DOMAIN)
def test_what_is_wrong_in_a_domain_is_refused_in_its_place(name: str) -> None:
    text, says, advises = IN_DOMAIN[name]
    with pytest.raises(DomainError) as caught:
        instantiate(parse_domain(Source("robots.pddl", marked(text)[0])))
    check(caught.value, "robots.pddl", text, says, advises)


@pytest.mark.parametrize("name", IN_PROBLEM)
def test_what_is_wrong_in_a_problem_is_refused_in_its_place(name: str) -> None:
    text, says, advises = IN_PROBLEM[name]
    domain = parse_domain(Source("robots.pddl", DOMAIN % "(:action go :effect (open home))"))
    with pytest.raises(DomainError) as caught:
        instantiate(domain, parse_problem(Source("errand.pddl", marked(text)[0]), domain))
    check(caught.value, "errand.pddl", text, says, advises)


def test_the_skeletons_themselves_are_fine() -> None:
    domain = parse_domain(Source("robots.pddl", action()))
    instantiate(domain, parse_problem(Source("errand.pddl", problem("(:init)")), domain))
    instantiate(parse_domain(Source("robots.pddl", process("(increase (speed) #t)"))))


def test_a_missing_static_value_is_told_where_it_belongs() -> None:
    text = DOMAIN % "(:action go :parameters (?r - robot) :precondition (> (charge ?r) 1))"
    domain = parse_domain(Source("robots.pddl", text))
    given = "(:objects r3 - robot) «(:init» (= (charge r2) 4))"
    given = problem(given).replace("(:objects hall - place)", "")
    source = Source("errand.pddl", marked(given)[0])
    with pytest.raises(DomainError) as caught:
        instantiate(domain, parse_problem(source, domain))
    says = "`(charge r3)` has no value, but `robots.pddl:7:57` reads it"
    check(caught.value, "errand.pddl", given, says, "(= (charge r3) ...)")


# Files -----------------------------------------------------------------------------------------


def test_an_empty_file_and_one_of_comments(tmp_path: Path) -> None:
    path = tmp_path / "d.pddl"
    for text in ("", "\n\n", "; nothing\n;; here", "\ufeff"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(DomainError, match="holds no PDDL definition") as caught:
            load_domain(path)
        assert (caught.value.file, caught.value.line, caught.value.column) == (str(path), 1, 1)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(DomainError, match="there is no such file") as caught:
        load_domain(tmp_path / "none.pddl")
    assert str(tmp_path / "none.pddl") in str(caught.value)
    for folder in (tmp_path, ".", "/", ""):
        with pytest.raises(DomainError, match="cannot be read"):
            load_domain(folder)
    good = tmp_path / "d.pddl"
    good.write_text("(define (domain d))")
    with pytest.raises(DomainError, match="there is no such file"):
        load_domain(good, tmp_path / "none.pddl")
    latin = tmp_path / "latin.pddl"
    latin.write_bytes("(define (domain d)) ; für".encode("latin-1"))
    with pytest.raises(DomainError, match="byte 23 is not valid UTF-8") as caught:
        load_domain(latin)
    assert caught.value.advice == "save the file as UTF-8"


def test_line_ends_tabs_and_a_byte_order_mark_move_no_place(tmp_path: Path) -> None:
    path = tmp_path / "d.pddl"
    text = "(define (domain d)\n\t(:predicates (p))\n\t(:action a\n\t\t:effect (q)))\n"
    for encoded in (
        text.encode(),
        text.replace("\n", "\r\n").encode(),
        b"\xef\xbb\xbf" + text.encode(),
    ):
        path.write_bytes(encoded)
        with pytest.raises(DomainError) as caught:
            load_domain(path)
        assert (caught.value.line, caught.value.column) == (4, 12)
        assert caught.value.source_line == "  :effect (q)))"
        assert caret_text(caught.value) == "q"
        path.write_bytes(encoded.replace(b"(q)", b"(p)"))
        assert [a.name for a in load_domain(path).model.actions] == ["a"]


def test_the_problem_beside_the_domain_is_found(tmp_path: Path) -> None:
    (tmp_path / "d.pddl").write_text("(define (domain d) (:predicates (p ?x)))")
    assert load_domain(tmp_path / "d.pddl").problem_source is None
    (tmp_path / "d-problem.pddl").write_text("(define (problem e) (:objects o1 o2))")
    (tmp_path / "other.pddl").write_text("(define (problem e) (:objects o3))")
    fluents = [f.name for f in load_domain(tmp_path / "d.pddl").model.fluents]
    assert fluents == ["p o1", "p o2"]
    other = load_domain(tmp_path / "d.pddl", tmp_path / "other.pddl")
    assert [f.name for f in other.model.fluents] == ["p o3"]
    assert other.problem_source is not None
    assert other.problem_source.name == str(tmp_path / "other.pddl")


def test_control_characters_reach_no_terminal() -> None:
    with pytest.raises(DomainError) as caught:
        parse_domain(Source("d.pddl", "(define (domain \x1b31mred\x07))"))
    assert all(c.isprintable() for c in str(caught.value).replace("\n", ""))
    assert caret_text(caught.value) == " 31mred "


def test_case_does_not_matter() -> None:
    domain = parse_domain(Source("d.pddl", "(DEFINE (DOMAIN D) (:Predicates (P)) (:ACTION A))"))
    assert (domain.name, list(domain.declarations)) == ("d", ["p"])


def test_numbers() -> None:
    text = "(define (domain d) (:functions (f)) (:action a :effect (assign (f) {})))"
    for word in ("1", "-1", "+1.5", ".5", "5.", "1e3", "-2.5E-1"):
        read = instantiate(parse_domain(Source("d.pddl", text.format(word))))
        assert read.parameters[0].value == float(word)
    for word in ("1e", "0x10", "1_000", "nan", "inf", "--1", "1e5.5", "٣", "1,5"):
        with pytest.raises(DomainError, match="expected a number"):
            parse_domain(Source("d.pddl", text.format(word)))
