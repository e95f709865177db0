from __future__ import annotations

import pytest

from serp.learning.schedule import LinearSchedule


def test_moves_in_a_straight_line_and_stays() -> None:
    schedule = LinearSchedule(1.0, 0.2, 8)
    assert [schedule(t) for t in (0, 2, 4, 8, 100)] == pytest.approx([1.0, 0.8, 0.6, 0.2, 0.2])


def test_no_steps_means_the_end_at_once() -> None:
    assert LinearSchedule(1.0, 0.1, 0)(0) == 0.1


def test_equal_ends_are_constant() -> None:
    schedule = LinearSchedule(0.3, 0.3, 10)
    assert {schedule(t) for t in range(20)} == {0.3}
