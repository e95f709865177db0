"""What is wrong is refused where it stands, by its code; test_slips.py has what is advised.

In the texts, `«` and `»` enclose the place that the message must name; they are taken out before
the text is read.
"""

import re

import pytest

from serp.model.domain import load_domain
from serp.model.grounder import instantiate
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import DomainError, Source
from tests.generated import Texts, load_texts
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


def action(effect="(tired)", precondition="(and)"):
    return DOMAIN % (
        f"(:action go :parameters (?r - robot ?p - place)\n    :precondition {precondition}"
        f"\n    :effect {effect})"
    )


def with_math(number):
    text = action(f"(increase (speed) {number})")
    return text.replace(":adl", ":adl :math-functions", 1)


def process(effect):
    return DOMAIN % f"(:process run :parameters () :precondition (and) :effect {effect})"


def problem(section):
    return PROBLEM % section


LONG = "\n 1" * 150


# fmt: off
IN_DOMAIN = [
    ("unbalanced-parentheses", "«)»"),
    ("stray-text", "«hello»"),
    ("unbalanced-parentheses", "(" * 100 + "«(»"),
    ("stray-text", "(define«\u00a0»(domain d))"),
    ("malformed", "(define «(domain)»)"),
    ("unknown-section", DOMAIN % "(«:actoin» go)"),
    ("unsupported", DOMAIN % "(«:durative-action» go)"),
    ("declared-twice", DOMAIN % "«(:types car)»"),
    ("malformed", "(define (domain d) (:requirements «(:typing)»))"),
    ("type-conflict", "(define (domain d) (:types a - b «b» - c c - b))"),
    ("reserved-name", "(define (domain d) (:types «object» - a))"),
    ("malformed", "(define (domain d) (:predicates (p «-» a)))"),
    ("unknown-name", "(define (domain d) (:predicates (p ?x - «car»)))"),
    ("type-conflict", "(define (domain d) (:types b c) (:constants «a» - (either b c)))"),
    ("wrong-kind",
     "(define (domain d) (:predicates (p)) (:functions (p)) (:action a :precondition («p»)))"),
    ("reserved-name", "(define (domain d) (:predicates («when»)))"),
    ("declared-twice", "(define (domain d) (:types t) (:action go :parameters (?x - t «?x»)))"),
    ("unsupported", "(define (domain d) (:types t) (:functions (f) - «t»))"),
    ("reserved-name", "(define (domain d) (:functions «(unsafe)»))"),
    ("malformed", DOMAIN % "«(:action)»"),
    ("declared-twice", DOMAIN % "(:action go) (:event «go»)"),
    ("missing-value", DOMAIN % "(:action go «:effect»)"),
    ("unknown-name", action(precondition="(and («opne» ?p))")),
    ("unknown-name", action(precondition="(open «?q»)")),
    ("unknown-name", action(precondition="(open «homr»)")),
    ("wrong-arguments", action(precondition="(open «?r»)")),
    ("unsupported", action(precondition="«(preference a (tired))»")),
    ("malformed", action("(increase (speed) «charge»)")),
    ("wrong-kind", action("(increase (speed) («tired»))")),
    ("malformed", action("(increase (speed) «1e400»)")),
    ("math-functions", action("(increase (speed) («max» 1 2))")),
    ("no-result", with_math("(sqrt «-1»)")),
    ("reserved-name", action("(increase (speed) «(reward)»)")),
    ("malformed", action("(increase (speed) (* «#t» 2))")),
    ("too-large", action(f"(increase (speed) «(+{LONG})»)")),
    ("unsupported", action("«(or (tired) (open ?p))»")),
    ("reserved-name", action("«(not (unsafe))»")),
    ("reserved-name", action("«(assign (reward) 1)»")),
    ("wrong-arguments", action("(increase (charge «?p») 1)")),
    ("malformed", process("(increase (speed) «(speed)»)")),
    ("malformed", process("«(assign (speed) #t)»")),
    ("malformed", process("«(when (tired) (increase (speed) #t))»")),
]

IN_PROBLEM = [
    ("malformed", "(define «(domain d)»)"),
    ("declared-twice", problem("(:init) «(:init)»")),
    ("unsupported", problem("(«:constraints» (and))")),
    ("declared-twice", problem("").replace("hall", "«home» - robot hall")),
    ("unknown-name", problem("(:init (open «?x»))")),
    ("malformed", problem("(:init «tired»)")),
    ("declared-twice", problem("(:init (tired) «(not (tired))»)")),
    ("reserved-name", problem("(:init «(unsafe)»)")),
    ("reserved-name", problem("(:init (= (reward) «5»))")),
    ("declared-twice", problem("(:init (= (speed) 1) «(= (speed) 2)»)")),
    ("malformed", problem("(:init (= (speed) «(+ 1 2)»))")),
    ("unsupported", problem("(:init «(at 5 (tired))»)")),
    ("malformed", problem("«(:metric maximize)»")),
    ("reserved-name", problem("«(:metric minimize (reward))»")),
    ("unknown-name", problem("(:metric minimize («is-violated» a))")),
]
# fmt: on


def marked(text):
    """Take the marks out: the text, line and column of the place, and what is shown of it."""
    before, inside, after = re.fullmatch("([^«]*)«([^»]*)»([^»]*)", text, re.DOTALL).groups()
    line = before.count("\n") + 1
    column = len(before.rsplit("\n", 1)[-1]) + 1
    return before + inside + after, line, column, inside.split("\n")[0]


def check(error, file, text, code):
    plain, line, column, shown = marked(text)
    assert (error.file, error.line, error.column) == (file, line, column), str(error)
    assert error.code == code
    check_rendering(error, plain)
    assert caret_text(error) == (shown if shown.isprintable() else " ")


@pytest.mark.parametrize(("code", "text"), IN_DOMAIN)
def test_what_is_wrong_in_a_domain_is_refused_in_its_place(code, text):
    with pytest.raises(DomainError) as caught:
        instantiate(parse_domain(Source("robots.pddl", marked(text)[0])))
    check(caught.value, "robots.pddl", text, code)


@pytest.mark.parametrize(("code", "text"), IN_PROBLEM)
def test_what_is_wrong_in_a_problem_is_refused_in_its_place(code, text):
    domain = parse_domain(Source("robots.pddl", DOMAIN % "(:action go :effect (open home))"))
    with pytest.raises(DomainError) as caught:
        instantiate(domain, parse_problem(Source("errand.pddl", marked(text)[0]), domain))
    check(caught.value, "errand.pddl", text, code)


def test_a_missing_static_value_is_told_where_it_belongs():
    text = DOMAIN % "(:action go :parameters (?r - robot) :precondition (> (charge ?r) 1))"
    domain = parse_domain(Source("robots.pddl", text))
    given = "(:objects r3 - robot) (:init (= (charge r2) 4))"
    given = problem(given).replace("(:objects hall - place)", "")
    source = Source("errand.pddl", given)
    ground = instantiate(domain, parse_problem(source, domain))
    assert "go r3" not in [action.name for action in ground.actions]
    (warning,) = [w for w in source.warnings if w.code == "missing-value"]
    assert "`(charge r3)` has no value" in warning.text and warning.place.text == "(:init"


# Files -----------------------------------------------------------------------------------------


def test_an_empty_file_and_one_of_comments(tmp_path):
    path = tmp_path / "d.pddl"
    for text in ("", "\n\n", "; nothing\n;; here", "\ufeff"):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(DomainError, match="holds no PDDL definition") as caught:
            load_domain(path)
        assert (caught.value.file, caught.value.line, caught.value.column) == (str(path), 1, 1)


def test_files_that_cannot_be_read(tmp_path):
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


def test_line_ends_tabs_and_a_byte_order_mark_move_no_place(tmp_path):
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


def test_the_problem_beside_the_domain_is_found(tmp_path):
    (tmp_path / "d.pddl").write_text("(define (domain d) (:predicates (p ?x)))")
    assert load_domain(tmp_path / "d.pddl").problem_source is None
    (tmp_path / "d-problem.pddl").write_text("(define (problem e) (:objects o1 o2))")
    (tmp_path / "other.pddl").write_text("(define (problem e) (:objects o3))")
    fluents = [f.name for f in load_domain(tmp_path / "d.pddl").model.fluents]
    assert fluents == ["p o1", "p o2"]
    other = load_domain(tmp_path / "d.pddl", tmp_path / "other.pddl")
    assert [f.name for f in other.model.fluents] == ["p o3"]
    assert other.problem_source.name == str(tmp_path / "other.pddl")


def test_numbers():
    text = "(define (domain d) (:functions (f)) (:action a :effect (assign (f) {})))"
    for word in ("1", "-1", "+1.5", ".5", "5.", "1e3", "-2.5E-1"):
        read = instantiate(parse_domain(Source("d.pddl", text.format(word))))
        assert read.parameters[0].value == float(word)
    for word in ("1e", "0x10", "1_000", "nan", "inf", "--1", "1e5.5", "٣", "1,5"):
        with pytest.raises(DomainError, match="expected a number"):
            parse_domain(Source("d.pddl", text.format(word)))


@pytest.mark.parametrize(
    ("effect", "refused"),
    [
        ("(assign (x) 1) (increase (x) 1)", True),
        ("(scale-up (x) 2) (decrease (x) 1)", True),
        ("(assign (x) (y)) (assign (x) 1) (assign (x) 2)", True),
        ("(assign (f ?i) 1) (and (p) (scale-down (f ?i) 2))", True),
        ("(when (p) (and (assign (x) 1) (increase (x) 1)))", True),
        ("(forall (?j - t) (and (assign (f ?j) 1) (increase (f ?j) 1)))", True),
        ("(increase (x) 1) (decrease (x) (y))", False),
        ("(scale-up (x) 2) (scale-down (x) (y))", False),
        ("(assign (x) 1) (assign (y) 2) (assign (x) 1.0) (assign (x) (y))", False),
        ("(assign (f ?i) 1) (increase (f o) 1)", False),
        ("(assign (x) 1) (when (p) (increase (x) 1)) (when (not (p)) (increase (x) 1))", False),
    ],
)
def test_effects_that_always_contradict_each_other_are_refused(effect, refused):
    texts = Texts(
        "(define (domain d) (:types t) (:constants o - t) (:predicates (p))"
        " (:functions (x) (y) (f ?i - t))\n"
        f" (:action act :parameters (?i - t) :precondition (and)\n :effect (and {effect})))",
        None,
    )
    if not refused:
        load_texts(texts)
        return
    with pytest.raises(DomainError, match=r"contradicts .* in line 3: both would") as raised:
        load_texts(texts)
    assert raised.value.line == 3
