"""A caption fits its band, whatever it says."""

from __future__ import annotations

import numpy as np
import pytest

from serp.control.decision import Actor
from serp.viz.caption import Caption, CaptionBand, Cell, Mark

LONG = "side-advance-very-far-to-the-left " * 20


@pytest.mark.parametrize("width", [64, 200, 640, 1920])
def test_captions_of_one_width_have_one_size(width: int) -> None:
    band = CaptionBand(width)
    for actor in (None, *Actor):
        for action, marks in (("", ()), (LONG, (Mark(LONG, LONG),) * 2), ("x", (Mark("a", ""),))):
            cells = [Cell(Actor.LEARNER, True)] * 1000
            for outcome in ("", "home", LONG):
                caption = Caption(actor, action, (LONG, "step 1"), marks, cells, outcome)
                assert band.draw(caption).size == band.size


def test_every_actor_looks_different_and_a_refusal_too() -> None:
    band = CaptionBand(640)
    looks = [band.draw(Caption(actor, "go", ())).tobytes() for actor in Actor]
    looks += [
        band.draw(Caption(Actor.PLANNER, "go", (), strip=[Cell(Actor.PLANNER, refused)])).tobytes()
        for refused in (True, False)
    ]
    assert len(set(looks)) == len(looks)


def test_where_room_is_short_the_return_is_what_stays() -> None:
    band = CaptionBand(330)
    facts = ("episode 1", "step 22", "return +3.00")
    whole = np.asarray(band.draw(Caption(Actor.LEARNER, "charge-opponent", facts)))
    last = np.asarray(band.draw(Caption(Actor.LEARNER, "charge-opponent", facts[-1:])))
    none = np.asarray(band.draw(Caption(Actor.LEARNER, "charge-opponent", ())))
    assert (whole == last).all()
    assert (last != none).any()
