import pytest

from tests.serp.model.learned.rolls import from_text
from tests.serp.runs.diagnosis.made_up import ROBOTS


@pytest.fixture
def model():
    """The model of a small world with two robots."""
    return from_text(ROBOTS).model.replace(dt=0.5)
