import pytest

from tests.serp.runs.comparison import contest


@pytest.fixture
def external(monkeypatch):
    """External algorithms are installed: those of `contest`, and one that is broken."""
    found = contest.external_algorithms()
    broken = type(found["lazy"])("broken", "tests.serp.nosuch:make", "serp.algorithms")
    monkeypatch.setattr(
        "serp.runs.comparison.algorithms.algorithm_entries", lambda: {**found, "broken": broken}
    )
