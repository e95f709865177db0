from __future__ import annotations

from collections.abc import Iterator

import pytest

from serp.threads import one_thread


@pytest.fixture(scope="session", autouse=True)
def single_threaded() -> Iterator[None]:
    """As in a training: small systems of equations are solved ten times as fast."""
    with one_thread():
        yield
