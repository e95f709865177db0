from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from serp.domain.model import TransitionModel
from serp.threads import one_thread
from tests.serp.correction.truth import robots


@pytest.fixture(scope="session", autouse=True)
def single_threaded() -> Iterator[None]:
    """As in a training: small systems of equations are solved ten times as fast."""
    with one_thread():
        yield


@pytest.fixture
def model(tmp_path: Path) -> TransitionModel:
    """The world of `robots`, for tests of what people are shown."""
    return robots(tmp_path)
