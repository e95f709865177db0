from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def fresh_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep compiled models out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SERP_CACHE_DIR", str(tmp_path_factory.mktemp("models")))
        yield
