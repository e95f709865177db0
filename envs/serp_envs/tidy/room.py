"""The room, the robot and the things as MuJoCo's MJCF, with the places that controllers use."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray


class Thing(NamedTuple):
    """Something to tidy up.

    Attributes:
        place: Where it belongs, `drawer` or `shelf`.
        radius: Half its width, m.
        half: Half its height, m.
        mass: Bounds between which its mass is drawn in each episode, kg.
        friction: Bounds of the friction coefficient between it and a new gripper.
        grip: Height of the grip over its middle, m.
    """

    place: str
    radius: float
    half: float
    mass: tuple[float, float]
    friction: tuple[float, float]
    grip: float = 0.02


class Pose(NamedTuple):
    """Where the base stands: m, m, and the direction that it faces, rad."""

    x: float
    y: float
    heading: float


THINGS: Final = {
    "block": Thing("drawer", 0.026, 0.05, (0.3, 0.6), (0.45, 0.8)),
    "can": Thing("drawer", 0.033, 0.055, (0.4, 0.8), (0.45, 0.8)),
    "bottle": Thing("shelf", 0.036, 0.11, (0.5, 0.9), (0.45, 0.8)),
    "glass": Thing("shelf", 0.031, 0.07, (0.4, 0.6), (0.45, 0.8), 0.035),
}
"""What lies on the table at the start, by name. The glass is full."""
PLACES: Final = {
    "table": Pose(-1.70, 0.0, pi),
    "drawer": Pose(1.28, -0.4, 0.0),
    "shelf": Pose(0.7, 1.65, 0.5 * pi),
    "charger": Pose(-0.2, -1.85, -0.5 * pi),
}
"""Where the robot stops, by name."""
ROOM: Final = {
    "table": (0.1, 0.75),
    "drawer": (0.1, 0.3),
    "shelf": (0.4, 0.1),
    "charger": (0.1, 0.1),
}
"""How far the base may be off such a pose and still be there: along x and y, m."""
FACING: Final = 0.97
"""Least cosine of the angle by which it may be turned away."""
Number = TypeVar("Number", float, NDArray[np.float64])


def stands_at(place: str, x: Number, y: Number, cosine: Number, sine: Number) -> Any:
    """Return whether the base stands at a place, facing it, so near that the arm can work.

    Args:
        place: Key of `PLACES`.
        x: Position of the base, m; numbers or arrays of one shape.
        y: Likewise.
        cosine: Of its heading.
        sine: Of its heading.
    """
    to, (room_x, room_y) = PLACES[place], ROOM[place]
    facing = cosine * cos(to.heading) + sine * sin(to.heading) > FACING
    return (abs(x - to.x) < room_x) & (abs(y - to.y) < room_y) & facing


TABLE: Final = 0.70
BOARD: Final = 0.95
FLOOR: Final = 0.52
"""Heights of the table, of the shelf's board, of the drawer's floor, m."""
ROW: Final = -2.45
"""The things stand in a row on the table: their x, m."""
SPREAD: Final = (-0.54, -0.18, 0.18, 0.54)
"""Middles of their places in that row: y, m."""
TRAVEL: Final = 0.36
"""Way of the drawer from closed to open, m."""
HANDLE: Final = (2.12, 0.60)
"""Handle of the closed drawer: x and height, m."""
BASE_RADIUS: Final = 0.25
PERSON_RADIUS: Final = 0.22
WALK: Final = ((-1.2, 0.6), (-1.1, 0.9))
"""The person walks within these bounds of x and y, m."""
REACH: Final = 0.42
"""Distance from the middle of the base to the grip while the arm is retracted, m."""
STROKE: Final = 0.50
"""Way of the arm, m."""
TIMESTEP: Final = 0.01
"""Step of the physics, s."""


def lies_on_table(x: Number, y: Number, z: Number) -> Any:
    """Return whether a thing that is not held lies on the table; numbers or arrays of one shape."""
    return (z > TABLE) & (x < -2.15) & (abs(y) < 0.85)


def _thing(name: str, thing: Thing) -> str:
    """Round things touch as boxes do: four steady contacts, which are cheap."""
    colour = {"block": ".3 .5 .8 1", "can": ".8 .25 .2 1", "bottle": ".2 .55 .3 1"}.get(
        name, ".6 .85 .95 .7"
    )
    width = thing.radius
    shown = (
        f'<geom type="cylinder" size="{width} {thing.half}" rgba="{colour}" mass="0"/>'
        if name != "block"
        else ""
    )
    return (
        f'<body name="{name}" pos="{ROW} 0 {TABLE + thing.half}"><freejoint/>{shown}'
        f'<geom name="{name}" type="box" size="{width} {width} {thing.half}" mass=".4" '
        f'rgba="{colour}" group="{3 if shown else 0}" contype="1" conaffinity="1"/></body>'
    )


def _pairs() -> str:
    """Contacts of the gripper have a friction of their own, which wears."""
    held = "".join(
        f'<pair geom1="{side}" geom2="{thing}" condim="4" friction=".7 .7 .004 .0001 .0001" '
        'solref=".02 1"/>'
        for thing in (*THINGS, "handle")
        for side in ("left", "right")
    )
    return (
        held
        + '<pair geom1="base" geom2="person"/><pair geom1="arm" geom2="person"/>'
        + "".join(f'<pair geom1="{side}" geom2="front"/>' for side in ("left", "right"))
    )


XML: Final = f"""
<mujoco model="tidy">
  <option timestep="{TIMESTEP}" integrator="implicitfast" cone="elliptic" impratio="10"
          iterations="20"/>
  <visual><global offwidth="640" offheight="480"/><map znear=".01"/><headlight ambient=".45 .45 .45"
          diffuse=".5 .5 .5"/></visual>
  <default><geom contype="0" conaffinity="0" friction=".5 .005 .0001"/></default>
  <asset>
    <texture type="skybox" builtin="flat" rgb1=".96 .96 .97" rgb2=".96 .96 .97" width="32"
             height="192"/>
    <texture name="tiles" type="2d" builtin="checker" rgb1=".86 .83 .78" rgb2=".8 .77 .72"
             width="200" height="200"/>
    <material name="tiles" texture="tiles" texrepeat="6 5"/>
  </asset>
  <worldbody>
    <light pos="0 0 4" dir="0 0 -1" diffuse=".5 .5 .5"/>
    <camera name="room" pos="-.1 -4.9 4.3" xyaxes="1 0 0 0 .69 .73" fovy="50"/>
    <geom name="ground" type="plane" size="3 2.5 .1" material="tiles" contype="1"
          conaffinity="1"/>
    <geom name="table" type="box" pos="-2.5 0 {TABLE - 0.02}" size=".3 .85 .02"
          rgba=".62 .45 .3 1" contype="1" conaffinity="1"/>
    <geom type="box" pos="-2.5 -.8 .34" size=".25 .03 .34" rgba=".5 .36 .24 1"/>
    <geom type="box" pos="-2.5 .8 .34" size=".25 .03 .34" rgba=".5 .36 .24 1"/>
    <geom name="board" type="box" pos=".7 2.36 {BOARD - 0.015}" size=".5 .16 .015"
          rgba=".7 .6 .45 1" contype="1" conaffinity="1"/>
    <geom type="box" pos=".2 2.36 .6" size=".015 .16 .6" rgba=".6 .5 .38 1"/>
    <geom type="box" pos="1.2 2.36 .6" size=".015 .16 .6" rgba=".6 .5 .38 1"/>
    <geom type="box" pos=".7 2.36 .45" size=".5 .16 .015" rgba=".7 .6 .45 1"/>
    <geom type="box" pos="2.58 -.4 .24" size=".4 .32 .24" rgba=".75 .75 .72 1"/>
    <geom type="box" pos="2.58 -.4 .80" size=".4 .32 .02" rgba=".75 .75 .72 1"/>
    <geom type="box" pos="2.58 -.71 .64" size=".4 .015 .16" rgba=".75 .75 .72 1"/>
    <geom type="box" pos="2.58 -.09 .64" size=".4 .015 .16" rgba=".75 .75 .72 1"/>
    <geom type="box" pos="-.2 -2.4 .2" size=".2 .08 .2" rgba=".25 .6 .35 1"/>
    <body name="drawer" pos="2.38 -.4 {FLOOR}">
      <joint name="drawer" type="slide" axis="-1 0 0" range="0 {TRAVEL}" damping="12"
             frictionloss="3"/>
      <geom name="bottom" type="box" pos="0 0 -.01" size=".18 .27 .01" rgba=".85 .8 .6 1"
            mass="2" contype="1" conaffinity="1"/>
      <geom name="front" type="box" pos="-.19 0 .03" size=".01 .28 .05" rgba=".9 .88 .8 1"
            contype="1" conaffinity="1"/>
      <geom type="box" pos="0 .28 .03" size=".18 .01 .05" rgba=".85 .8 .6 1"/>
      <geom type="box" pos="0 -.28 .03" size=".18 .01 .05" rgba=".85 .8 .6 1"/>
      <geom name="handle" type="cylinder" pos="{HANDLE[0] - 2.38} 0 {HANDLE[1] - FLOOR}"
            size=".012 .04" rgba=".2 .2 .2 1"/>
    </body>
    <body name="person" mocap="true" pos="0 1 .85">
      <geom name="person" type="capsule" size="{PERSON_RADIUS} .6" rgba=".85 .6 .45 1"/>
      <geom type="sphere" pos="0 0 .95" size=".13" rgba=".95 .8 .65 1"/>
    </body>
    <body name="base" gravcomp="1">
      <joint name="x" type="slide" axis="1 0 0"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <joint name="heading" type="hinge" axis="0 0 1"/>
      <geom name="base" type="cylinder" pos="0 0 .16" size="{BASE_RADIUS} .13"
            rgba=".3 .32 .36 1" mass="40"/>
      <geom type="cylinder" pos="0 .22 .06" size=".06 .02" euler="90 0 0" rgba=".1 .1 .1 1"/>
      <geom type="cylinder" pos="0 -.22 .06" size=".06 .02" euler="90 0 0" rgba=".1 .1 .1 1"/>
      <geom type="box" pos="-.06 0 .75" size=".03 .05 .6" rgba=".55 .57 .6 1" mass="4"/>
      <body name="lift" gravcomp="1">
        <joint name="lift" type="slide" axis="0 0 1" range=".3 1.4"/>
        <geom type="box" pos=".05 0 0" size=".1 .045 .045" rgba=".35 .45 .6 1" mass="3"/>
        <body name="arm" pos="{REACH} 0 0" gravcomp="1">
          <joint name="arm" type="slide" axis="1 0 0" range="0 {STROKE}"/>
          <geom name="arm" type="capsule" fromto="-.35 0 0 -.08 0 0" size=".025"
                rgba=".8 .82 .85 1" mass="1"/>
          <geom type="box" pos="-.06 0 0" size=".015 .07 .02" rgba=".3 .3 .32 1" mass=".3"/>
          <body name="left" pos="0 .055 0" gravcomp="1">
            <joint name="left" type="slide" axis="0 -1 0" range="0 .055"/>
            <geom name="left" type="box" pos="0 .006 0" size=".022 .006 .02" rgba=".2 .2 .2 1"
                  mass=".1"/>
            <geom type="box" pos="-.035 .006 0" size=".02 .005 .01" rgba=".3 .3 .3 1"
                  mass=".05"/>
          </body>
          <body name="right" pos="0 -.055 0" gravcomp="1">
            <joint name="right" type="slide" axis="0 1 0" range="0 .055"/>
            <geom name="right" type="box" pos="0 -.006 0" size=".022 .006 .02"
                  rgba=".2 .2 .2 1" mass=".1"/>
            <geom type="box" pos="-.035 -.006 0" size=".02 .005 .01" rgba=".3 .3 .3 1"
                  mass=".05"/>
          </body>
        </body>
      </body>
    </body>
    {"".join(_thing(name, thing) for name, thing in THINGS.items())}
  </worldbody>
  <contact>{_pairs()}</contact>
  <actuator>
    <velocity name="x" joint="x" kv="600"/>
    <velocity name="y" joint="y" kv="600"/>
    <velocity name="heading" joint="heading" kv="60"/>
    <position name="lift" joint="lift" kp="3000" kv="250"/>
    <position name="arm" joint="arm" kp="2000" kv="150"/>
    <position name="left" joint="left" kp="600" kv="15" forcerange="-10 10"/>
    <position name="right" joint="right" kp="600" kv="15" forcerange="-10 10"/>
  </actuator>
</mujoco>
"""
