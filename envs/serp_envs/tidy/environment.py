"""The environment: physics, the person, the battery, what is observed and what it is worth."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from ctypes.util import find_library
from math import acos, cos, dist, hypot, sin
from typing import Any, Final, SupportsInt

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # Read when mujoco is imported, which fails where the library is missing.
    there = [name for name in ("EGL", "OSMesa") if find_library(name)]
    os.environ.setdefault("MUJOCO_GL", there[0].lower() if there else "disable")

import mujoco

from serp_envs.tidy.controllers import MACROS, PERIOD
from serp_envs.tidy.room import (
    BASE_RADIUS,
    BOARD,
    FLOOR,
    PERSON_RADIUS,
    ROW,
    SPREAD,
    TABLE,
    THINGS,
    TIMESTEP,
    WALK,
    XML,
    lies_on_table,
    stands_at,
)

Observation = NDArray[np.float32]

OBSERVED: Final = (
    "x", "y", "cos-heading", "sin-heading", "battery", "opening", "person-x", "person-y",
    "hit", "spilled", "tilt glass",
    *(f"{what} {name}" for name in THINGS for what in ("x", "y", "z", "held", "tidy", "lost")),
)  # fmt: skip
"""Names of the numbers of an observation, see `TidyRoom`."""
TIDY: Final = 1.0
DONE: Final = 1.0
SECOND: Final = 0.01
LOST: Final = 0.5
DAMAGE: Final = 5.0
"""Rewards: a thing in its place; all of them and the drawer closed; minus: a second; a thing on the
floor; the person hit, the glass spilled, the battery empty."""
LYING: Final = 0.8
"""A thing that is tilted so far lies on its side, and the arm cannot pick it up, rad."""
GENTLE: Final = 9.0
"""Force of a finger that closes, N; what has been lifted is held with `FIRM`."""
STICK: Final = (0.4, 1.2)
"""Bounds of the factor of friction that each grasp draws."""
SPILL: Final = 0.35
"""What is in the full glass spills when its surface leans so far in it, rad."""
GRAVITY: Final = 9.81
"""m/s²."""
PACE: Final = 0.5
"""Speed of the person, m/s."""
PASS: Final = BASE_RADIUS + PERSON_RADIUS + 0.15
"""A drive passes the person at this distance, m."""
NOTICED: Final = 0.65
"""The person walks round a robot that is slower than this, m/s."""
DRAIN: Final = (0.0012, 0.006)
"""Battery used in a second, and for a metre at 1 m/s; twice as much a metre at twice the speed."""
CHARGE: Final = 0.08
"""Battery charged in a second."""

_SUBSTEPS: Final = round(PERIOD / TIMESTEP)


class TidyRoom(gym.Env[Observation, np.int64]):
    """A mobile manipulator clears a table into a drawer and a shelf, around a person.

    ## Description

    A base on wheels carries a lift, a telescopic arm and a gripper with two fingers. Four things
    stand on a table: a block and a can belong into a drawer, a bottle and a full glass onto a
    shelf. A person walks between them. An action is a controller (`MACROS`) that sets the targets
    of the actuators every 0.05 s until it is done; MuJoCo does the rest. Nothing fails by a coin:

    * A grasp slips where friction does not bear the weight. Mass and friction of a thing are drawn
      for an episode, and how well the pads stick for every grasp. `wear` takes friction away.
    * A thing that a finger hits falls over, since the robot knows its place to a centimetre.
    * A drive stops before the person, and gives up after 3 s. A rush (1.4 m/s instead of 0.6) does
      not look. The person walks round a robot that is slower than 0.65 m/s.
    * What is in the glass leans where the glass is tilted or the base accelerates. A drive does
      so by 1.2 m/s² at most, a rush by 5 m/s², which spills it.
    * Out of reach, with a full gripper, before a closed drawer a controller gives up at once.

    ## Action space

    `Discrete(23)`, in the order of `MACROS`: `drive` and `rush` to each of the four places
    (`PLACES`), `approach` and `grasp` each of the four things (`THINGS`), `place-on-shelf`,
    `place-in-drawer`, `put-back` (onto the table), `open-drawer`, `close-drawer`, `wait` (1 s) and
    `charge` (10 s at most). They last 0.5 to 20 s.

    ## Observation space

    `Box` of shape `(35,)`, float32, named by `OBSERVED`: position (m) and heading of the base,
    battery (0 to 1), opening of the drawer (m), position of the person, whether the robot has hit
    the person, whether the glass is spilled, its tilt (rad); for each thing its position (m), and
    whether it is held, tidy and lost.

    ## Reward

    1 for each thing in its place, 1 when all are there and the drawer is closed, −0.01 for a
    second, −0.5 for a thing that fell over or down, −5 for damage.

    ## Episode end

    1. Termination: everything is tidy or lost, and the drawer is closed.
    2. Termination, with `info["unsafe"]`: the robot has run into the person (`hit`), the surface in
       the glass leans by more than 0.35 rad (`spilled`), the battery is empty (`empty`).
    3. Truncation: after 80 decisions, by the `TimeLimit` of `gymnasium.make`.

    Equal seeds give equal episodes bit for bit, on one version of MuJoCo.

    ## Arguments

    * `render_mode`: `None` or `"rgb_array"` (uint8 of shape `(360, 480, 3)`), which needs OpenGL,
      but no screen and no GPU.
    * `wear`: share of its friction that the gripper has lost; the attribute `wear` may be changed
      at any time.

    Attributes:
        wear: See above.
        on_tick: Called after every 0.05 s, for films; None: nothing is.
        seconds: Age of the episode.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (gymnasium declares it so)
        "render_modes": ["rgb_array"],
        "render_fps": 2,
    }

    def __init__(self, render_mode: str | None = None, wear: float = 0.0) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode must be None or 'rgb_array', not {render_mode!r}")
        if not 0.0 <= wear <= 1.0:
            raise ValueError(f"wear must be a share of the friction, from 0 to 1, not {wear!r}")
        self.render_mode = render_mode
        self.wear = wear
        self.action_space = spaces.Discrete(len(MACROS))
        size = len(OBSERVED)
        self.observation_space = spaces.Box(-10.0, 10.0, (size,), np.float32)
        self.model = mujoco.MjModel.from_xml_string(XML)
        self.data = mujoco.MjData(self.model)
        self.on_tick: Callable[[], None] | None = None
        model = self.model
        self._addresses = {
            name: int(model.joint(model.body(name).jntadr[0]).qposadr[0]) for name in THINGS
        }
        self._bodies = {name: model.body(name).id for name in THINGS}
        self._shape = {
            name: model.body_inertia[body] / model.body_mass[body]
            for name, body in self._bodies.items()
        }
        self._opening = int(model.joint("drawer").qposadr[0])
        self._base = int(model.joint("x").qposadr[0])
        self._base_dof = int(model.joint("x").dofadr[0])
        self._geoms = {model.geom(name).id for name in ("base", "arm")}
        self._person = model.geom("person").id
        fingers = {model.geom(side).id: side for side in ("left", "right")}
        others = {model.geom(name).id: name for name in (*THINGS, "handle")}
        self._pairs = {
            pair: others[other]
            for pair in range(model.npair)
            for finger, other in (
                sorted(
                    (int(model.pair_geom1[pair]), int(model.pair_geom2[pair])),
                    key=lambda geom: geom not in fingers,
                ),
            )
            if finger in fingers and other in others
        }
        self._renderer: Any = None
        self._axes, self._places = self.data.xmat, self.data.xpos
        self._qpos, self._qvel, self._ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self._gripper = model.body("arm").id

    # Episodes ------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode."""
        super().reset(seed=seed)
        rng, model, data = self.np_random, self.model, self.data
        self._friction = {"handle": 1.2}
        ys = rng.permutation(SPREAD) + rng.uniform(-0.05, 0.05, len(SPREAD))
        for name, thing in THINGS.items():
            mass = rng.uniform(*thing.mass)
            body = self._bodies[name]
            model.body_inertia[body] = mass * self._shape[name]
            model.body_mass[body] = mass
            self._friction[name] = rng.uniform(*thing.friction)
        mujoco.mj_setConst(model, data)
        mujoco.mj_resetData(model, data)
        for (name, thing), y in zip(THINGS.items(), ys, strict=True):
            at = self._addresses[name]
            data.qpos[at : at + 3] = ROW + rng.uniform(-0.03, 0.03), y, TABLE + thing.half
        self.velocity, self._velocity = (0.0, 0.0, 0.0), [0.0, 0.0]
        self.lift, self.arm, self.held = 1.1, 0.0, ""
        data.qpos[self._base : self._base + 2] = rng.uniform((-0.6, -1.7), (0.6, -1.4))
        data.qpos[self._base + 2] = rng.uniform(-3.0, 3.0)
        data.joint("lift").qpos = self.lift
        self.battery, self.charging = float(rng.uniform(0.35, 0.7)), False
        x, y = self._somewhere()
        self.person = x, abs(y)
        self._waypoint, self._rest = self.person, 0.0
        data.mocap_pos[0, :2] = self.person
        self.close_gripper(False)
        self._stick = 1.0
        self._set_friction()
        self.tidy = dict.fromkeys(THINGS, False)
        self.lost = dict.fromkeys(THINGS, False)
        self.hit = self.spilled = False
        self.seconds = 0.0
        self._tick()
        return self._observation(), self._info()

    def step(self, action: SupportsInt) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Run a macro-action to its end, or to the end of the episode."""
        assert self.action_space.contains(action), f"{action!r} is an invalid action"
        before, tidied, lost = self.seconds, sum(self.tidy.values()), sum(self.lost.values())
        for _ in list(MACROS.values())[int(action)](self):
            self._tick()
            if self._damaged():
                break
        self.velocity, self.charging = (0.0, 0.0, 0.0), False
        self._look()
        reward = -SECOND * (self.seconds - before)
        reward += TIDY * (sum(self.tidy.values()) - tidied)
        reward -= LOST * (sum(self.lost.values()) - lost)
        damaged, done = self._damaged(), self.done
        reward += DONE * done - DAMAGE * damaged
        return self._observation(), reward, damaged or done, False, self._info()

    def get_action_meanings(self) -> list[str]:
        """Return the names of the actions."""
        return [*MACROS]

    def _damaged(self) -> bool:
        return self.hit or self.spilled or self.battery <= 0.0

    @property
    def done(self) -> bool:
        """Whether nothing is left to do: each thing in its place or lost, the drawer closed."""
        return self.opening < 0.04 and all(self.tidy[n] or self.lost[n] for n in THINGS)

    def _set_friction(self) -> None:
        for pair, other in self._pairs.items():
            friction = self._friction[other] * self._stick * (1.0 - self.wear)
            self.model.pair_friction[pair, :2] = friction

    def _tick(self) -> None:
        """Advance the physics by a control period."""
        data = self.data
        self._ctrl[:5] = *self.velocity, self.lift, self.arm
        speed = hypot(*self._qvel[self._base_dof : self._base_dof + 2].tolist())
        self._walk(speed)
        mujoco.mj_step(self.model, data, _SUBSTEPS)
        self.seconds += PERIOD
        self.battery -= PERIOD * (DRAIN[0] + DRAIN[1] * speed * max(1.0, speed))
        if self.charging:
            self.battery = min(1.0, self.battery + CHARGE * PERIOD)
        self.battery = max(self.battery, 0.0)
        if speed > 0.05 and self._near < 1.0:
            pairs = data.contact.geom
            touched = pairs[(pairs == self._person).any(axis=1)]
            self.hit |= any(int(geom) in self._geoms for geom in touched.ravel())
        self._slosh()
        if self.held and self._from_grip(self.held) > 0.12:
            self.held = ""
        if self.on_tick is not None:
            self.on_tick()

    def _slosh(self) -> None:
        """Spill what is in the glass if its surface is too steep in it, or the glass lies below.

        The surface is perpendicular to gravity and acceleration together (d'Alembert). The
        acceleration of a held glass is that of the base, as the mean of a control period.
        """
        velocity = self._qvel[self._base_dof : self._base_dof + 2].tolist()
        push_x, push_y = (
            (velocity[k] - self._velocity[k]) / PERIOD if self.held == "glass" else 0.0
            for k in range(2)
        )
        self._velocity = velocity
        body = self._bodies["glass"]
        x, y, z = self._axes[body, 2::3].tolist()
        upwards = (x * push_x + y * push_y + z * GRAVITY) / hypot(push_x, push_y, GRAVITY)
        self.spilled |= upwards < cos(SPILL) or bool(self._places[body, 2] < 0.4)

    def _walk(self, speed: float) -> None:
        """Move the person: to a waypoint, a rest, the next one; a slow robot is walked round."""
        (px, py), (x, y, _) = self.person, self.pose
        self._near = hypot(px - x, py - y)
        if self._rest > 0.0:
            self._rest -= PERIOD
            return
        way_x, way_y = self._waypoint[0] - px, self._waypoint[1] - py
        far = hypot(way_x, way_y)
        if far < PACE * PERIOD:
            self._rest = float(self.np_random.uniform(0.0, 4.0))
            self._waypoint = self._somewhere()
            return
        there = px + way_x * PACE * PERIOD / far, py + way_y * PACE * PERIOD / far
        near = hypot(there[0] - x, there[1] - y)
        if near < min(self._near, PASS) and speed < NOTICED:
            self._waypoint = self._somewhere()
            return
        self.person = there
        self.data.mocap_pos[0, :2] = there

    def _somewhere(self) -> tuple[float, float]:
        x, y = (float(self.np_random.uniform(low, high)) for low, high in WALK)
        return x, y

    def _look(self) -> None:
        """Judge which things are in their places, and which are on the floor."""
        for name, thing in THINGS.items():
            if name == self.held:
                continue
            x, y, z = self.where(name)
            self.lost[name] |= z < 0.4 or self.tilt(name) > LYING
            if thing.place == "shelf":
                there = z > BOARD and y > 2.2
            else:
                there = FLOOR < z < TABLE and x > 1.7
            self.tidy[name] |= there and not self.lost[name]

    # What controllers use ------------------------------------------------------------------------

    @property
    def pose(self) -> tuple[float, float, float]:
        """Position (m) and heading (rad) of the base."""
        x, y, heading = self._qpos[self._base : self._base + 3].tolist()
        return x, y, heading

    @property
    def opening(self) -> float:
        """How far the drawer is open, m."""
        return float(self._qpos[self._opening])

    def where(self, name: str) -> tuple[float, float, float]:
        """Return the position of a thing, m."""
        x, y, z = self._places[self._bodies[name]].tolist()
        return x, y, z

    def on_table(self, name: str) -> bool:
        """Return whether a thing lies on the table."""
        return name != self.held and bool(lies_on_table(*self.where(name)))

    def from_base(self, name: str) -> tuple[float, float, float]:
        """Return how far ahead, to the left and how high a thing is, m."""
        x, y, z = self.where(name)
        bx, by, heading = self.pose
        c, s = cos(heading), sin(heading)
        return c * (x - bx) + s * (y - by), c * (y - by) - s * (x - bx), z

    def tilt(self, name: str) -> float:
        """Return the angle between a thing's axis and the vertical, rad."""
        return acos(min(1.0, max(-1.0, float(self._axes[self._bodies[name], 8]))))

    def at(self, place: str) -> bool:
        """Return whether the base stands at a place; see `stands_at`."""
        x, y, heading = self.pose
        return bool(stands_at(place, x, y, cos(heading), sin(heading)))

    def person_ahead(self, dx: float, dy: float, field: float) -> bool:
        """Return whether the person is on the way in a direction, nearer than `field`."""
        x, y, _ = self.pose
        px, py, way = self.person[0] - x, self.person[1] - y, hypot(dx, dy)
        along, beside = px * dx + py * dy, abs(px * dy - py * dx)
        return hypot(px, py) < field and along > 0.0 and beside < PASS * way

    def count(self, place: str) -> int:
        """Return how many things are in a place."""
        return sum(self.tidy[name] for name, thing in THINGS.items() if thing.place == place)

    def close_gripper(self, closed: bool) -> None:
        """Set the fingers' targets; closing stops at what is between them.

        How well the pads stick depends on where they meet a surface: dry here, damp there.
        """
        if closed:
            self._stick = float(self.np_random.uniform(*STICK))
            self._set_friction()
        self._ctrl[5:7] = 0.055 if closed else 0.0
        self.hold(GENTLE)

    def hold(self, force: float) -> None:
        """Set the largest force of a finger, N."""
        self.model.actuator_forcerange[5:7] = -force, force

    def _from_grip(self, name: str) -> float:
        return dist(self._places[self._gripper].tolist(), self.where(name))

    def below_grip(self, name: str) -> float:
        """Return how far the middle of a thing is below the grip, m."""
        return float(self._places[self._gripper][2]) - self.where(name)[2]

    def slipped(self, name: str, grip: float) -> bool:
        """Return whether the gripper has lost a thing that it lifts."""
        return self.below_grip(name) > grip + 0.02 or self._from_grip(name) > 0.08

    # What is seen --------------------------------------------------------------------------------

    def _observation(self) -> Observation:
        x, y, heading = self.pose
        seen = [
            x, y, cos(heading), sin(heading), self.battery, self.opening,
            *self.person, float(self.hit), float(self.spilled), self.tilt("glass"),
        ]  # fmt: skip
        for name in THINGS:
            state = name == self.held, self.tidy[name], self.lost[name]
            seen += [*self.where(name), *map(float, state)]
        return np.clip(np.array(seen, dtype=np.float32), -10.0, 10.0)

    def _info(self) -> dict[str, Any]:
        return {
            "unsafe": self._damaged(),
            "hit": self.hit,
            "spilled": self.spilled,
            "empty": self.battery <= 0.0,
            "dropped": sum(self.lost.values()),
            "tidied": sum(self.tidy.values()),
            "seconds": round(self.seconds, 3),
        }

    def render(self) -> NDArray[np.uint8] | None:
        """Return a picture in the mode `rgb_array`."""
        if self.render_mode is None:
            gym.logger.warn("render() without a render_mode draws nothing")
            return None
        return self.picture()

    def picture(self, width: int = 480, height: int = 360) -> NDArray[np.uint8]:
        """Return a picture of the room; the first call sets the size.

        Raises:
            DependencyNotInstalled: There is no OpenGL.
        """
        if self._renderer is None:
            try:
                self._renderer = mujoco.Renderer(self.model, height, width)
            except Exception as error:
                raise DependencyNotInstalled(
                    "MuJoCo found no OpenGL to draw with. Without a screen: `apt install libegl1 "
                    "libgl1-mesa-dri` and MUJOCO_GL=egl, or `apt install libosmesa6` and "
                    "MUJOCO_GL=osmesa"
                ) from error
        self._renderer.update_scene(self.data, "room")
        return np.asarray(self._renderer.render())

    def close(self) -> None:
        """Free the picture's memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
