"""What the pages say of the domain language and of scenarios is what these do."""

import re

import pytest

import serp
from serp.authoring.scenarios.reading import read_scenarios
from serp.model.reachability import BINDINGS_EACH, MAX_GROUND_SCHEMAS
from serp.pddl.source import Source
from tests.docs.pages import EXAMPLES, ROOT, code, tables

TEMPLATES = {
    "condition": "(:action do :parameters (?x - gate) :precondition (and {}) :effect (and))",
    **dict.fromkeys(
        ("number", "function"),
        "(:action do :parameters (?x - gate) :effect (and (assign (level) {})))",
    ),
    "effect": "(:action do :parameters (?x - gate) :effect (and {}))",
    "process": "(:process do :parameters (?x - gate) :effect (and {}))",
}
SURROUNDINGS = {
    ":types": "(:types gate side thing)",
    ":constants": "(:constants door - gate)",
    ":predicates": "(:predicates (open ?d - gate) (unsafe))",
    ":functions": "(:functions (level) (weight ?d - gate) (reward))",
}


def load_fragment(where, fragment, folder):
    """Load a domain around a fragment."""
    sections = dict(SURROUNDINGS)
    if where in ("section", "declaration"):
        sections[fragment.split()[0].strip("(")] = fragment
        if fragment.startswith("(:types"):
            del sections[":constants"], sections[":predicates"], sections[":functions"]
    else:
        sections["schema"] = TEMPLATES[where].format(fragment)
        sections[":requirements"] = "(:requirements :math-functions)" if where == "function" else ""
    file = folder / "fragment.pddl"
    file.write_text(f"(define (domain fragment) {' '.join(sections.values())})", encoding="utf-8")
    return serp.load_domain(file)


@pytest.mark.parametrize(("page", "where", "table"), tables("accepted in"))
def test_what_is_said_to_be_accepted_is_accepted(page, where, table, tmp_path):
    for row in table:
        domain = load_fragment(where, code(row[0]), tmp_path)
        assert where == "declaration" or domain.model.actions or domain.model.ground.processes


@pytest.mark.parametrize(("page", "where", "table"), tables("refused in"))
def test_what_is_said_to_be_refused_is_refused_so(page, where, table, tmp_path):
    for fragment, message, _ in table:
        with pytest.raises(serp.DomainError) as error:
            load_fragment(where, code(fragment), tmp_path)
        assert message in str(error.value)


STEPS = {
    "condition": "(:action try :parameters () :precondition (and {}) :effect (and))",
    "effect": "(:action try :parameters () :precondition (and) :effect (and {}))",
    **dict.fromkeys(
        ("process", "event", "flag"),
        "{} (:action try :parameters () :precondition (and) :effect (and))",
    ),
}


@pytest.mark.parametrize(("page", "kind", "table"), tables("one step"))
def test_the_guides_tell_what_happens_in_one_step(page, kind, table, tmp_path):
    tea = (EXAMPLES / "tea.pddl").read_text(encoding="utf-8").partition("  (:action")[0]
    problem = (EXAMPLES / "tea-problem.pddl").read_text(encoding="utf-8")
    # Fluents may have any value, and the rows name cups, which belong to the domain then.
    moved = re.compile(r"\(= \((temperature|water)\) .+\)\n|\(:objects .+\)\n")
    (tmp_path / "tea-problem.pddl").write_text(moved.sub("", problem), encoding="utf-8")
    tea += "(:constants red blue - cup)"
    file = tmp_path / "tea.pddl"
    for fragment, before, after, *_ in table:
        file.write_text(f"{tea} {STEPS[kind].format(code(fragment))})", encoding="utf-8")
        if "error: " in after:
            with pytest.raises(serp.DomainError) as error:
                serp.load_domain(file)
            assert code(after.partition("error: ")[2]) in str(error.value)
            continue
        model = serp.load_domain(file, observed=True).model.replace(dt=1.0)
        names = [fluent.name for fluent in model.fluents]
        values = dict.fromkeys(names, 0.0) | values_of(before)
        step = model.step([values[name] for name in names], "try")
        assert step.applicable == (after != "not applicable"), fragment
        assert step.unsafe == ("unsafe" in after.split(", ")), fragment
        assert step.terminal == ("the task ends" in after), fragment
        assert step.reward == pytest.approx(values_of(after).get("reward", 0.0)), fragment
        expected = values | values_of(after)
        assert list(step.state) == pytest.approx([expected[name] for name in names]), fragment


def values_of(cell):
    """The values of a cell such as "`temperature = 20`, `filled red`, `not heater-on`"."""
    values = {}
    for part in re.findall(r"`([^`]+)`", cell):
        name, _, number = part.partition(" = ")
        values[name.removeprefix("not ")] = float(number or not name.startswith("not "))
    return values


@pytest.mark.parametrize(("page", "kind", "table"), tables("scenarios"))
def test_statements_of_scenarios_are_read(page, kind, table):
    domain = serp.load_domain(ROOT / "domains" / "lunar-lander.pddl", observed=True)
    lines = [code(row[0]) for row in table]
    text = "".join(
        f"scenario {number}\n{line}\nallows fall\n"
        if kind == "situation"
        else f"scenario {number}\n{line}\n"
        for number, line in enumerate(lines)
    )
    source = Source("page.scenarios", f"scenario a lean\n(lean) = 1\nallows fall\n{text}")
    assert len(read_scenarios(source, domain, domain.model)) == len(lines) + 1


def test_the_limits_are_those_of_the_code():
    text = (ROOT / "docs" / "reference" / "domain-language.md").read_text(encoding="utf-8")
    limits = text.partition("## Limits\n")[2]
    limited = [each * MAX_GROUND_SCHEMAS for each in (1, BINDINGS_EACH)]
    for number in limited:
        assert f"| {number:,} |" in limits
