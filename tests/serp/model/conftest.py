from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def models_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")


@pytest.fixture(scope="module", autouse=True)
def fresh_cache(models_folder: Path) -> Iterator[None]:
    """Keep the hundreds of models that are made up here out of the user's cache.

    Per module: set for the whole session, it would also apply to the tests that run afterwards,
    and each process that they start would compile every loop again.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SERP_CACHE_DIR", str(models_folder))
        yield
