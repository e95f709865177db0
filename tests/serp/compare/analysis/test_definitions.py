from __future__ import annotations

from serp.compare.analysis.definitions import BY_NAME, MEASURES, extra_measures


def test_names_are_unique_and_meanings_are_sentences():
    assert len(BY_NAME) == len(MEASURES)
    for each in (*MEASURES, *extra_measures(["outcome.goal", "info.hits"])):
        assert each.meaning.endswith(".") and each.meaning[0].isupper()
        assert each.better in ("higher", "lower", None)


def test_measures_of_a_task_alone_are_added_once_and_in_order():
    found = extra_measures(["outcome.goal", "unsafe", "info.hits", "info.outcome.x"] * 2)
    assert [each.name for each in found] == ["info.hits", "info.outcome.x", "outcome.goal"]
    assert [each.title for each in found] == ["hits", "outcome.x", "outcome goal"]
