from __future__ import annotations

from pathlib import Path

import pytest

from serp.model.transition_model import TransitionModel
from tests.serp.diagnosis.made_up import robots


@pytest.fixture
def model(tmp_path: Path) -> TransitionModel:
    """The world of `robots`."""
    return robots(tmp_path)
