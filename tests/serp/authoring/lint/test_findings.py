"""All findings come in one pass, comments silence warnings, and other programs read them."""

import re

import pytest

from serp.authoring.lint.domain_pairs import Title, title_of
from serp.authoring.lint.findings import RULES, examine
from serp.pddl.source import Source
from serp.ui.commands.files import write_changed
from tests.serp.authoring.lint.checks_page import EXAMPLES, TEXT
from tests.serp.ui.cli.conftest import WALK, WALK_PROBLEM
from tests.worlds import DOMAINS

MANY = """\
(define (domain d)
  (:requirements :typing :adl :numeric-fluents)
  (:types place)
  (:predicates (at ?p - «plase») (open ?p - place) (unsafe))
  (:functions (speed) (reward))
  (:action go :parameters (?p - place)
    :precondition (and («opne» ?p) (> («sped») 3) (at ?p))
    :effect (and (increase (speed) «0,5») «(set (speed) 4)»))
  (:action open-all :parameters ()
    :effect (and (increase (speed) 1)«»
  (:action stop :parameters (?p - place)
    «:precondtion» (and (opne ?p))
    :effect (and (decrease (speed) (* 2 «#t»))))
  («:acton» bad :parameters ())
  (:event e :parameters () :precondition (and (> (speed) 2) «(< (speed) 1)»)
    :effect (and (unsafe))))
"""


def found_in(text, problem=None):
    given = None if problem is None else Source("p.pddl", problem)
    return examine(Source("d.pddl", text), given).findings


def test_a_file_is_what_its_first_lines_say_not_its_comments():
    problem = "; (domain old)\n(DEFINE (Problem p) ; of\n (:domain D) (:init (problem a)))"
    assert title_of(Source("p.pddl", problem)) == Title("problem", "d")
    assert title_of(Source("d.pddl", "(define (domain d) (:domain e))")) == Title("domain", "d")
    assert title_of(Source("x.pddl", "(define")) == Title("", "")


def test_all_that_is_wrong_is_found_in_one_pass_and_nothing_that_follows_from_it():
    starts, text = [], ""
    for part in re.split("([«»])", MANY):
        if part == "«":
            starts.append(len(text))
        elif part != "»":
            text += part
    findings = found_in(text)
    assert [f.place.start for f in findings if f.place] == starts, [f.rendered for f in findings]
    assert [f.severity for f in findings] == ["error"] * (len(starts) - 1) + ["warning"]
    again = text.replace(":event e ", ":event go ")  # of which the first could not be read
    assert "`go` is defined twice" in [f.message for f in found_in(again)]


@pytest.mark.parametrize(
    ("comment", "codes"),
    [
        ("", ["no-change"]),
        ("; serp: ignore[no-change]", []),
        ("; why not?  serp: ignore[no-change, unused-name]", []),
        ("; serp: ignore[no-chang]", ["no-change"]),
    ],
)
def test_a_comment_silences_a_warning_and_nothing_else(comment, codes):
    effect = ":precondition (and) :effect (and (increase (walked) 0)))"
    idle = f"(:action idle {effect} {{}}\n  (:action rest"
    above = f"{{}}\n  (:action idle {effect}"
    for form in (idle, above + "(:action rest"):
        text = WALK.replace("(:action rest", form.replace("{}", comment))
        assert sorted(f.code for f in found_in(text, WALK_PROBLEM)) == sorted(codes)
    anywhere = WALK.replace("(:action rest", idle.replace("{}", "")) + comment.replace(
        "ignore", "ignore-file"
    )
    assert sorted(f.code for f in found_in(anywhere, WALK_PROBLEM)) == sorted(codes)


def test_a_file_that_is_written_keeps_its_mark_its_line_ends_and_its_mode(tmp_path):
    file = tmp_path / "d.pddl"
    file.write_bytes(b"\xef\xbb\xbf; r\xc3\xa4d\r\n")
    file.chmod(0o640)
    write_changed(file, Source.read(file).text + "; more\r\n")
    assert file.read_bytes() == b"\xef\xbb\xbf; r\xc3\xa4d\r\n; more\r\n"
    assert file.stat().st_mode & 0o777 == 0o640


def test_the_page_explains_every_code_with_an_example_that_has_it():
    lamps = re.search(r"```pddl\n(.*?)```", TEXT, re.S)
    assert [f.rendered for f in found_in(lamps[1])] == []
    without = {code for code, example in EXAMPLES.items() if not example}
    whole = {"too-large", "unreadable-file", "missing-domain", "no-action", "no-reward"}
    assert without == {*whole, "out-of-range", "task-mismatch", "unbounded-goal"}
    assert {rule.code for rule in RULES} <= EXAMPLES.keys()
    for code, example in EXAMPLES.items():
        problem = f"(define (problem p) (:domain lamps) {PROBLEM})"
        text = lamps[1]
        if example.startswith("(:domain"):
            problem = problem.replace("(:domain lamps)", example)
        elif example:
            for section in re.findall(r"\((:[a-z]+)", example):
                if section not in (":action", ":event", ":process"):
                    text = re.sub(rf"\({section} .*\)\n", "", text)
            text = text.replace("  (:action switch", f"  {example}\n  (:action switch")
        codes = [f.code for f in found_in(text, problem)]
        assert not example or code in codes, (code, codes)


PROBLEM = "(:init (on desk) (= (level) 1)) (:goal (and))"


def test_a_lost_parenthesis_is_told_in_its_place_and_once():
    text = (DOMAINS / "cliff.pddl").read_text()
    code = re.sub(";[^\n]*", lambda match: " " * len(match[0]), text)
    near = 0
    places = [match.start() for match in re.finditer(r"[()]", code)][::4]
    for place in places:
        errors = [f for f in found_in(text[:place] + text[place + 1 :]) if f.severity == "error"]
        assert 1 <= len(errors) <= 2, [f.rendered for f in errors]
        line = text.count("\n", 0, place) + 1
        near += any(f.place is not None and abs(f.place.line - line) <= 1 for f in errors)
    assert near >= 0.98 * len(places)
