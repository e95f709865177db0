"""What all tests rely on."""

import gc
import signal
from pathlib import Path
from types import SimpleNamespace

import pytest


def pytest_configure():
    """Let Ctrl-C mean what it means in a terminal, also where a background job ignores it."""
    gc.disable()
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish():
    """Let the garbage collector pass over what the imports made, which took it a fifth of the time.

    It does not run before, so that nothing is looked through while it is made.
    """
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items):
    """Begin with what takes longest: the files beside this one, then all but those of `serp`."""
    here = Path(__file__).parent
    items.sort(key=lambda item: (item.path.is_relative_to(here / "serp"), item.path.parent != here))


@pytest.fixture(autouse=True, scope="session")
def _without_learning_curves():
    """To draw one takes longer than a training; `test_learning_curve.py` does."""
    blank = SimpleNamespace(savefig=lambda file, **options: None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.learning_curve.learning_curve", lambda metrics, title: blank)
        yield
