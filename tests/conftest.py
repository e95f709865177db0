"""What all tests rely on."""

import gc
import signal


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
