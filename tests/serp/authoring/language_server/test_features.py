"""What an editor is told of any position of any file."""

from __future__ import annotations

from random import Random

import pytest

pytest.importorskip("pygls")

from serp.authoring.language_server.completion import completions, explained
from serp.authoring.language_server.index import Index
from serp.authoring.language_server.server import Positions, code_actions
from serp.authoring.lint.findings import findings_of
from serp.pddl.source import Source
from tests.serp.pddl.test_fuzz import SHIPPED, damage
from tests.serp.ui.cli.conftest import WALK

POSITIONS = Positions()


def test_damaged_files_are_explained_as_far_as_they_can_be_read() -> None:
    for seed in range(25):
        random = Random(seed)
        texts = damage(random.choice(SHIPPED), random)
        source = Source("d.pddl", texts.domain)
        index = Index(source)
        whole = POSITIONS.range(source.place(0, len(source.text)))
        list(code_actions(findings_of(source), "d.pddl", whole, POSITIONS))
        for _ in range(15):
            position = random.randrange(len(source.text) + 1)
            at = POSITIONS.position(source, position)
            assert POSITIONS.offset(source, at) == position
            explained(index, source, position)
            completions(index, source, position)
            if (here := index.at(source, position)) is not None:
                assert {o.place.text.lower() for o in index.same(here)} == {here.name}


@pytest.mark.parametrize(
    ("before", "texts"),
    [
        ("(define (domain walk)\n  (:re", [":requirements"]),
        ("(:requirements :typ", [":typing"]),
        ("(at ?p - ", ["place", "object", "number"]),
        (":parameters (?a - place ?b - place)\n    :precondition (and (at ?", ["?a", "?b"]),
        (":precondition (and (a", ["at", "and", "assign"]),
        (":parameters ()\n    :pre", [":predicates", ":precondition"]),
        ("; a comm", []),
    ],
)
def test_what_can_stand_there_is_offered_though_the_form_is_not_complete(
    before: str, texts: list[str]
) -> None:
    index = Index(Source("d.pddl", WALK))
    start = next((k for k in range(len(before), 0, -1) if before[:k] in WALK), 0)
    text = WALK[: WALK.index(before[:start]) + start] + before[start:]
    found = completions(index, Source("d.pddl", text), len(text))
    assert [item.label for item in found] == texts
