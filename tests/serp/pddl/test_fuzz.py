"""Broken files load or are refused with a place; nothing else happens, and soon."""

import re
import time
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.authoring.lint.findings import examine
from serp.pddl.source import DomainError, Source
from tests.generated import FULL, Texts, examples, load_texts, write_texts
from tests.generated.models import DOMAIN_FILE, PROBLEM_FILE
from tests.serp.authoring.lint.checks_page import EXAMPLES
from tests.serp.pddl.rendering import check_rendering

REPOSITORY = Path(__file__).parents[3]
TOKEN = re.compile(r"\s+|;[^\n]*|[()]|[^\s();]+")
WORDS = (
    *("(", ")", "()", "(and)", "and", "or", "not", "imply", "forall", "exists", "when", "either"),
    *("=", "<", ">=", "+", "-", "*", "/", "#t", "0", "-1", "1e400", ".", "?", "?x", "object"),
    *("assign", "increase", "scale-down", "reward", "unsafe", "terminal", "total-time", "define"),
    *(":types", ":constants", ":predicates", ":functions", ":action", ":process", ":event"),
    *(":parameters", ":precondition", ":effect", ":init", ":goal", ":metric", ":objects"),
    *(":requirements", ":math-functions", "sqrt", "min", "atan2"),
    *("class", "lambda", "import", "__import__", "exec", "s", "a", "n", "theta", "dt", "out"),
    *("é", "x" * 5000, "\u00a0", "\ufeff", "\x00", "\x1b[2J", "'", '"', "\\", "{", "}", "`", "%s"),
)
CHARACTERS = "()?:;-#=. \t\r\n\x00\x1b\u00a0\u2028\ufefféa0"


def shipped():
    texts = []
    for path in sorted(
        [*REPOSITORY.glob("domains/*.pddl"), *Path(__file__).parent.rglob("*.pddl")]
    ):
        if not path.stem.endswith("-problem"):
            problem = path.with_name(f"{path.stem}-problem.pddl")
            texts.append(
                Texts(path.read_text(), problem.read_text() if problem.is_file() else None)
            )
    return texts


SHIPPED = shipped()


def damaged(text, random):
    """Drop, double, exchange, replace or insert a few tokens or characters."""
    tokens = TOKEN.findall(text)
    for _ in range(random.randint(1, 5)):
        if not tokens:
            break
        at, other = random.randrange(len(tokens)), random.randrange(len(tokens))
        match random.randrange(8):
            case 0:
                del tokens[at]
            case 1:
                tokens.insert(at, tokens[other])
            case 2:
                tokens[at], tokens[other] = tokens[other], tokens[at]
            case 3:
                tokens[at] = tokens[other]
            case 4:
                tokens[at] = random.choice(WORDS)
            case 5:
                tokens.insert(at, f" {random.choice(WORDS)} ")
            case 6:
                place = random.randint(0, len(tokens[at]))
                added = random.choice(CHARACTERS)
                tokens[at] = tokens[at][:place] + added + tokens[at][place:]
            case 7:
                place = random.randint(0, len(tokens[at]))
                tokens[at] = tokens[at][:place] + tokens[at][place + 1 :]
    return "".join(tokens)


def load_or_refuse(texts):
    """Whether the texts load; what loads can be stepped, what does not says where it fails."""
    started = time.monotonic()
    try:
        model = load_texts(texts).model
    except DomainError as error:
        assert error.file in (DOMAIN_FILE, PROBLEM_FILE)
        text = texts.domain if error.file == DOMAIN_FILE else texts.problem
        check_rendering(error, text)
        return False
    finally:
        assert time.monotonic() - started < 10.0
    for state in (np.zeros(len(model.fluents)), np.ones(len(model.fluents))):
        for action in range(min(len(model.actions), 5)):
            outcome = model.step(state, action)
            assert np.isfinite(outcome.state).all()
            model.trace(state, action)
    return True


def check_findings(texts):
    """Check that reading on behind errors finds at least the one at which loading ends."""
    problem = None if texts.problem is None else Source(PROBLEM_FILE, texts.problem)
    findings = examine(Source(DOMAIN_FILE, texts.domain), problem).findings
    assert {finding.code for finding in findings} <= EXAMPLES.keys()
    errors = [finding.message for finding in findings if finding.severity == "error"]
    try:
        load_texts(texts)
    except DomainError as error:
        assert error.problem in errors
    else:
        assert errors == []


def damage(texts, random):
    if texts.problem is None or random.randint(0, 2):
        return Texts(damaged(texts.domain, random), texts.problem)
    return Texts(texts.domain, damaged(texts.problem, random))


@pytest.mark.parametrize("block", range(4))
def test_damaged_domains_load_or_are_refused(block):
    loaded = 0
    for seed in range(150):
        random = Random(f"{block}/{seed}")
        texts = random.choice(SHIPPED) if block % 2 else write_texts(random, FULL)
        texts = damage(texts, random)
        loaded += load_or_refuse(texts)
        if seed % 5 == 0:
            check_findings(texts)
    assert 2 < loaded < 120  # some of the damage does no harm


@given(st.lists(st.sampled_from(WORDS), max_size=40))
@examples(150)
def test_any_words_load_or_are_refused(words):
    body = " ".join(words)
    load_or_refuse(Texts(f"(define (domain d) {body})", None))
    load_or_refuse(Texts(f"(define (domain d) (:functions (x)) (:action a :effect {body}))", None))


def test_every_cut_of_a_file_is_refused():
    text = SHIPPED[-1].domain
    for end in range(0, len(text.rstrip()), 7):
        assert not load_or_refuse(Texts(text[:end], None))


# Deep, long and many ---------------------------------------------------------------------------


def over_and_over(wrapping, inner, times):
    for _ in range(times):
        inner = wrapping % inner
    return inner


@pytest.mark.parametrize(
    "condition",
    [
        over_and_over("(not (and (q) %s))", "(p)", 45),
        f"(= (x) {over_and_over('(/ %s 3)', '(x)', 20)})",
        f"(= (x) (+ {'1 ' * 100}))",
        over_and_over("(not %s)", "(p)", 90),
        over_and_over("(or (q) (and (p) %s))", "(p)", 45),
        over_and_over("(forall (?x) %s)", "(p)", 90),
        f"(= (x) {over_and_over('(/ 3 %s)', '(x)', 90)})",
        f"(or {'(not (q)) (p) ' * 1500})",
    ],
)
def test_deep_and_wide_conditions_run(condition):
    model = load_texts(
        Texts(
            "(define (domain d) (:constants o) (:predicates (p) (q)) (:functions (x))"
            f" (:action a :precondition {condition} :effect (and (p) (when {condition} (q)))))",
            None,
        )
    ).model
    states = np.array([[1.0, 1.0, 0.5], [1.0, 0.0, 0.0], [0.0, 1.0, 100.0], [0.0, 0.0, 3.0]])
    single = np.array([model.step(state, "a").state for state in states])
    traced = np.array([model.traced(state.tolist(), 0)[0][:-1] for state in states])
    assert model.step(states, "a").state.tobytes() == single.tobytes() == traced.tobytes()


@pytest.mark.parametrize(
    "text",
    [
        "(" * 100_000,
        "(define " + "(and " * 5_000 + ")" * 5_001,
        f"(define (domain {'d' * 200_000}))",
        "(define (domain d) " + "(:action a)" * 5_000 + ")",
        f"(define (domain d) (:predicates (p {'?x ' * 5_000})))",
        ";" * 1_000_000,
        f"(define (domain d) (:constants {' '.join(f'o{k}' for k in range(20_000))} oo o1))",
    ],
)
def test_absurd_files_do_not_take_long(text):
    load_or_refuse(Texts(text, None))
