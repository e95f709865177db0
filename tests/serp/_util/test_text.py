"""Words in messages."""

from __future__ import annotations

from serp._util.text import did_you_mean, plural


def test_advice_lists_a_few_known_names_when_none_is_close() -> None:
    assert did_you_mean("sped", ["speed", "charge"]) == "did you mean `speed`?"
    assert did_you_mean("xyz", ["speed", "charge"]) == "known here: `charge`, `speed`"
    assert did_you_mean("xyz", [f"f{k}" for k in range(20)]).endswith("`f15` and 12 more")
    assert did_you_mean("xyz", []) == ""


def test_plurals() -> None:
    assert [plural(n, "step") for n in (0, 1, 1200)] == ["0 steps", "1 step", "1,200 steps"]
    assert plural(2, "process", "processes") == "2 processes"
