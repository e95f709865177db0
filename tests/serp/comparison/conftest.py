from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from tests.serp.comparison import contest


@pytest.fixture(autouse=True, scope="package")
def _one_thread() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture
def guests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Algorithms from outside are installed: those of `contest`, and one that is broken."""
    found = contest.guests()
    broken = type(found["lazy"])("broken", "tests.serp.comparison.nosuch:make", "serp.algorithms")
    monkeypatch.setattr(
        "serp.comparison.algorithms.algorithm_entries", lambda: {**found, "broken": broken}
    )
