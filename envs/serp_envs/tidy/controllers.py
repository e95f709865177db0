"""The macro-actions: controllers that set targets every control period until they are done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import cos, hypot, remainder, sin, sqrt, tau
from typing import TYPE_CHECKING, Final

from serp_envs.tidy.room import (
    BOARD,
    FLOOR,
    HANDLE,
    PLACES,
    REACH,
    ROW,
    SPREAD,
    STROKE,
    TABLE,
    THINGS,
    Pose,
)

if TYPE_CHECKING:
    from serp_envs.tidy.environment import TidyRoom

PERIOD: Final = 0.05
"""A controller sets its targets this often, s."""
DRIVE: Final = (0.6, 0.6)
RUSH: Final = (1.4, 5.0)
"""Largest speed and acceleration of driving, m/s and m/s²."""
FIELD: Final = 1.1
"""A drive stops while the person is nearer than this on the way ahead, m: 0.6 m at which arm and
person touch, 0.2 m that the base needs to stop, and 0.3 m that the person walks meanwhile (the
protective distance of ISO 13855)."""
PATIENCE: Final = 3.0
"""A drive that is blocked gives up after this time, s."""
LONGEST: Final = 15.0
"""So does one that does not arrive within this time, s."""
CARRY: Final = 1.10
"""Height of the gripper while driving, m."""
FIRM: Final = 20.0
"""Force of a finger that holds what has been lifted, N."""
ROOM_TO_PLACE: Final = 0.2
"""The drawer has to be open so far to put something in, m."""

Controller = Callable[["TidyRoom"], Iterator[None]]


def _pause(env: TidyRoom, seconds: float) -> Iterator[None]:
    for _ in range(round(seconds / PERIOD)):
        yield


def _reach(env: TidyRoom, lift: float, arm: float, speed: float = 0.5) -> Iterator[None]:
    """Move lift and arm to a height and an extension, m, at a speed, m/s."""
    step = speed * PERIOD
    while env.lift != lift or env.arm != arm:
        env.lift += min(max(lift - env.lift, -step), step)
        env.arm += min(max(arm - env.arm, -step), step)
        yield
    yield from _pause(env, 0.15)


def _grip(env: TidyRoom, closed: bool) -> Iterator[None]:
    env.close_gripper(closed)
    yield from _pause(env, 0.4)


def _steer(env: TidyRoom, goal: Pose, limits: tuple[float, float], scan: bool) -> Iterator[None]:
    """Drive straight to a pose, turning on the way; where the person is in the way, wait."""
    top, acceleration = limits
    speed, blocked = 0.0, 0.0
    for _ in range(round(LONGEST / PERIOD)):
        x, y, heading = env.pose
        dx, dy = goal.x - x, goal.y - y
        turn, far = remainder(goal.heading - heading, tau), hypot(dx, dy)
        if far < 0.01 and abs(turn) < 0.01:
            break
        ahead = scan and env.person_ahead(dx, dy, FIELD)
        wanted = 0.0 if ahead else min(top, sqrt(acceleration * far), 3.0 * far)
        blocked = blocked + PERIOD if ahead else 0.0
        change = acceleration * PERIOD
        speed = min(wanted, speed + change) if wanted > speed else max(wanted, speed - 2 * change)
        if blocked > PATIENCE:
            break
        share = speed / max(far, 1e-6)
        spin = 0.0 if ahead else min(max(3.0 * turn, -1.5), 1.5)
        env.velocity = (share * dx, share * dy, spin)
        yield
    env.velocity = (0.0, 0.0, 0.0)
    yield from _pause(env, 0.2)


def _drive(place: str, limits: tuple[float, float], scan: bool) -> Controller:
    def run(env: TidyRoom) -> Iterator[None]:
        yield from _reach(env, CARRY, 0.0)
        # Where the robot takes itself to be is off by a centimetre.
        error = env.np_random.normal(0.0, (0.01, 0.01, 0.01))
        yield from _steer(env, Pose(*(PLACES[place] + error)), limits, scan)

    return run


def _approach(name: str) -> Controller:
    def run(env: TidyRoom) -> Iterator[None]:
        """Move along the table until the thing is straight ahead."""
        if not env.at("table") or not env.on_table(name):
            yield from _pause(env, 0.5)
            return
        yield from _reach(env, CARRY, 0.0)
        error = env.np_random.normal(0.0, 0.006)
        place, y = PLACES["table"], env.where(name)[1]
        yield from _steer(env, Pose(place.x, y + error, place.heading), (0.3, 0.5), True)

    return run


def _grasp(name: str) -> Controller:
    thing = THINGS[name]

    def run(env: TidyRoom) -> Iterator[None]:
        """Reach out, close the gripper, lift a little; what slips is let go again."""
        forward, aside, height = env.from_base(name)
        far = forward - REACH + env.np_random.normal(0.0, 0.008)
        if env.held or not 0.0 <= far <= STROKE or abs(aside) > 0.1 or height < 0.4:
            yield from _pause(env, 0.5)
            return
        height += thing.grip if env.tilt(name) < 0.5 else 0.0
        yield from _grip(env, closed=False)
        yield from _reach(env, height, 0.0)
        yield from _reach(env, height, far)
        yield from _grip(env, closed=True)
        yield from _reach(env, height + 0.04, far, 0.15)
        yield from _pause(env, 0.3)
        if env.slipped(name, thing.grip):
            yield from _reach(env, height, far)
            yield from _grip(env, closed=False)
            yield from _reach(env, height, 0.0)
        else:
            env.held = name
            env.hold(FIRM)
            yield from _reach(env, CARRY, far, 0.3)
        yield from _reach(env, CARRY, 0.0)

    return run


def _place(env: TidyRoom, where: str, support: float, aside: float, far: float) -> Iterator[None]:
    """Put down what is held, `far` ahead of the base after a move to the side."""
    thing, place = THINGS[env.held], PLACES[where]
    c, s = cos(place.heading), sin(place.heading)
    beside = Pose(place.x - aside * s, place.y + aside * c, place.heading)
    low = support + thing.half + env.below_grip(env.held)
    yield from _reach(env, max(low + 0.1, 0.0 if where == "shelf" else CARRY), 0.0)
    yield from _steer(env, beside, (0.3, 0.5), True)
    yield from _reach(env, env.lift, far - REACH)
    yield from _reach(env, low + 0.008, far - REACH, 0.3)
    yield from _grip(env, closed=False)
    env.held = ""
    yield from _reach(env, low + 0.008 if where == "shelf" else CARRY, env.arm)
    yield from _reach(env, env.lift, 0.0)
    yield from _reach(env, CARRY, 0.0)


def _place_on_shelf(env: TidyRoom) -> Iterator[None]:
    if not env.held or not env.at("shelf"):
        yield from _pause(env, 0.5)
        return
    aside = (0.3, 0.1, -0.1, -0.3)[env.count("shelf") % 4]
    yield from _place(env, "shelf", BOARD, aside, 0.70)


def _place_in_drawer(env: TidyRoom) -> Iterator[None]:
    if not env.held or not env.at("drawer") or env.opening < ROOM_TO_PLACE:
        yield from _pause(env, 0.5)
        return
    aside = (0.18, 0.06, -0.06, -0.18)[env.count("drawer") % 4]
    # In the middle between the front and the cabinet.
    far = 2.19 - 0.5 * env.opening - PLACES["drawer"].x
    yield from _place(env, "drawer", FLOOR, aside, far)


def _put_back(env: TidyRoom) -> Iterator[None]:
    """Put down on the table, where most room is."""
    if not env.held or not env.at("table"):
        yield from _pause(env, 0.5)
        return
    stand = [env.where(name)[1] for name in THINGS if name != env.held and env.on_table(name)]
    y = max(SPREAD, key=lambda y: min((abs(y - other) for other in stand), default=1.0))
    yield from _place(env, "table", TABLE, -y, PLACES["table"].x - ROW)


def _open_drawer(env: TidyRoom) -> Iterator[None]:
    """Grip the handle and pull; the pull ends where the arm is in."""
    if env.held or not env.at("drawer") or env.opening > 0.3:
        yield from _pause(env, 0.5)
        return
    yield from _steer(env, PLACES["drawer"], (0.3, 0.5), True)
    yield from _grip(env, closed=False)
    far = HANDLE[0] - env.opening - PLACES["drawer"].x - REACH
    yield from _reach(env, HANDLE[1], max(far - 0.1, 0.0))
    yield from _reach(env, HANDLE[1], far)
    yield from _grip(env, closed=True)
    yield from _reach(env, HANDLE[1], 0.05, 0.25)
    yield from _grip(env, closed=False)
    yield from _reach(env, HANDLE[1], 0.0)
    yield from _reach(env, CARRY, 0.0)


def _close_drawer(env: TidyRoom) -> Iterator[None]:
    """Push against the front, past the handle."""
    if env.held or not env.at("drawer") or env.opening < 0.02:
        yield from _pause(env, 0.5)
        return
    yield from _steer(env, PLACES["drawer"], (0.3, 0.5), True)
    yield from _grip(env, closed=False)
    yield from _reach(env, FLOOR + 0.03, 0.0)
    yield from _reach(env, FLOOR + 0.03, 0.475, 0.4)
    yield from _reach(env, FLOOR + 0.03, 0.0)
    yield from _reach(env, CARRY, 0.0)


def _wait(env: TidyRoom) -> Iterator[None]:
    yield from _pause(env, 1.0)


def _charge(env: TidyRoom) -> Iterator[None]:
    if not env.at("charger"):
        yield from _pause(env, 0.5)
        return
    for _ in range(round(10.0 / PERIOD)):
        env.charging = True
        yield
        if env.battery >= 1.0:
            break
    env.charging = False


MACROS: Final[dict[str, Controller]] = {
    **{f"drive {place}": _drive(place, DRIVE, True) for place in PLACES},
    **{f"rush {place}": _drive(place, RUSH, False) for place in PLACES},
    **{f"approach {name}": _approach(name) for name in THINGS},
    **{f"grasp {name}": _grasp(name) for name in THINGS},
    "place-on-shelf": _place_on_shelf,
    "place-in-drawer": _place_in_drawer,
    "put-back": _put_back,
    "open-drawer": _open_drawer,
    "close-drawer": _close_drawer,
    "wait": _wait,
    "charge": _charge,
}
"""The macro-actions by name, in the order of the actions."""
