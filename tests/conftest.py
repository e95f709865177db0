"""What all tests rely on."""

import gc
import signal
from pathlib import Path

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

    def late(item):
        first = item.path.relative_to(Path(__file__).parent).parts[0]
        return first == "serp", not first.endswith(".py")

    items.sort(key=late)


class _Blank:
    """A figure in whose file is nothing."""

    def savefig(self, file, **options):
        pass


@pytest.fixture(autouse=True, scope="session")
def _without_learning_curves():
    """To draw one takes longer than a training; `test_learning_curve.py` does."""
    with pytest.MonkeyPatch.context() as patch:
        name = "serp.runs.learning_curve.learning_curve"
        patch.setattr(name, lambda metrics, title: _Blank())
        yield
