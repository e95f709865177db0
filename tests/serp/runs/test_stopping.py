"""Ctrl-C, SIGTERM and SIGHUP during a training."""

import signal

import pytest

from serp.runs.train import SIGNALS, StoppedAtOnce, stop_between_episodes
from serp.ui.root import stopped_by


@pytest.fixture(autouse=True)
def as_before():
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("first", "second"), [(signal.SIGINT, signal.SIGINT), (signal.SIGHUP, signal.SIGTERM)]
)
def test_the_second_signal_stops_at_once_and_handlers_are_put_back(first, second):
    before = [signal.getsignal(number) for number in SIGNALS]
    with pytest.raises(KeyboardInterrupt) as stopped, stop_between_episodes():
        signal.raise_signal(first)
        signal.raise_signal(second)
    assert stopped_by(stopped.value) == 128 + second
    assert [signal.getsignal(number) for number in SIGNALS] == before


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_sent_to_process_and_group_is_one_request(number, monkeypatch):
    now = [10.0]
    monkeypatch.setattr("serp.runs.train.time.monotonic", lambda: now[0])
    with pytest.raises(StoppedAtOnce), stop_between_episodes() as stopping:
        for now[0] in (10.0, 10.01, 10.9):
            signal.raise_signal(number)
        assert stopping.signal == number
        now[0] = 12.0
        signal.raise_signal(number)
        pytest.fail("the second request was not heard")


@pytest.mark.parametrize(
    ("number", "handler"),
    [*((number, signal.SIG_IGN) for number in SIGNALS), (signal.SIGTERM, lambda *_: None)],
)
def test_a_signal_that_is_ignored_or_handled_stays_so(number, handler):
    signal.signal(number, handler)
    with stop_between_episodes() as stopping:
        signal.raise_signal(number)
        assert not stopping.requested
    assert signal.getsignal(number) is handler


def test_a_training_within_a_comparison_leaves_ctrl_c_to_it():
    with stop_between_episodes() as comparison, stop_between_episodes() as training:
        signal.raise_signal(signal.SIGINT)
        assert comparison.requested and not training.requested
