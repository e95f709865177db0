import os

import pytest


@pytest.fixture
def no_screen(monkeypatch):
    """Pygame draws without a display."""
    pytest.importorskip("pygame")
    monkeypatch.setitem(os.environ, "SDL_VIDEODRIVER", "dummy")
