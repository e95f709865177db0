"""Common mistakes are found, in their places, and the suggestions are right."""

import tomllib
from pathlib import Path

import pytest

from serp.authoring.lint.findings import examine
from serp.authoring.lint.task_ranges import out_of_range
from serp.pddl.parser import parse_domain, parse_problem
from serp.pddl.source import Source, edited
from serp.pddl.syntax import meaning
from serp.tasks.registry import task_of
from tests.serp.authoring.lint.checks_page import ERRORS, EXAMPLES
from tests.worlds import DOMAINS

EDITED = "edited.pddl"
MISTAKES = tomllib.loads(Path(__file__).with_name("mistakes.toml").read_text(encoding="utf-8"))[
    "mistake"
]


def sources(mistake, text):
    """Return the domain and the problem, one of them with another text."""
    name = mistake["file"].removesuffix("-problem")
    if name != mistake["file"]:
        return Source.read(DOMAINS / f"{name}.pddl"), Source(EDITED, text)
    problem = DOMAINS / f"{name}-problem.pddl"
    return Source(EDITED, text), Source.read(problem) if problem.is_file() else None


def made(mistake):
    """Return the original, the text with the mistake, and where it is to be found."""
    original = (DOMAINS / f"{mistake['file']}.pddl").read_text()
    assert mistake["old"] in original
    text = original.replace(mistake["old"], mistake["new"], 1)
    if "«" in text:
        return original, text.replace("«", "").replace("»", ""), text.index("«")
    place = mistake["place"].replace("«", "").replace("»", "")
    return original, text, text.index(place) + max(mistake["place"].find("«"), 0)


def of_task(domain):
    task = task_of(domain, Path(EDITED))
    with task.bind() as bound:
        yield from list(out_of_range(bound))


def tree(mistake, text):
    """Return what a file says, without places."""
    domain, problem = sources(mistake, text)
    syntax = parse_domain(domain)
    if problem is not None and problem.name == EDITED:
        parsed = parse_problem(problem, syntax)
        return meaning((tuple(parsed.objects.values()), *parsed.true_atoms, parsed.values))
    names = (*syntax.declarations.values(), *syntax.constants.values())
    return meaning((tuple(syntax.parents.items()), names, syntax.schemas))


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda m: f"{m['file']}-{m['code']}")
def test_a_mistake_is_found_in_its_place_with_the_right_suggestion(mistake):
    original, text, start = made(mistake)
    domain, problem = sources(mistake, text)
    look = of_task if mistake["code"] == "out-of-range" else None
    findings = examine(domain, problem, look=look).findings
    usual = {(f.code, f.message) for f in examine(*sources(mistake, original)).findings}
    found = [f for f in findings if (f.code, f.message) not in usual]
    (here,) = (f for f in found if f.code == mistake["code"] and where(f) == (EDITED, start))
    assert mistake["code"] in EXAMPLES
    # What follows from the mistake is told at most twice more.
    assert len({(f.code, f.message) for f in found}) <= 3, [f.rendered for f in found]
    if mistake["code"] in ERRORS:
        assert here.severity == "error"
        assert len({f.message for f in found if f.severity == "error"}) == 1
    if "fix" in mistake:
        assert tree(mistake, edited(text, here.fix.edits)) == tree(mistake, original)
    else:
        assert mistake.get("suggestion", "") in f"{here.message} {here.advice}"


def where(finding):
    return finding.place.source.name, finding.place.start
