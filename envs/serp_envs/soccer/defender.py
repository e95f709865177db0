"""The soccer defender of the SErP paper, section 4.2, as a Gymnasium environment."""

from __future__ import annotations

from serp_envs.soccer.contest import Contest
from serp_envs.soccer.environment import SoccerEnv
from serp_envs.soccer.fields import field_named


class SoccerDefender(SoccerEnv):
    """A robot defends its goal against an attacker that dribbles and shoots.

    ## Description

    The robot soccer task of the SErP paper, section 4.2: two robots of the Standard Platform
    League, seen from above, in a contest for the ball. The defender learns; the attacker follows a
    fixed policy (`serp_envs.soccer.opponents.attacker`). The physics is pymunk's in steps of
    0.02 s, a walk is limited to 0.25 m/s forward, 0.15 back, 0.20 sideways, 1.66 rad/s.
    Metres, seconds, radians; the origin is the centre spot, the defended goal at x = −4.5.

    An episode is one contest. It begins when both robots are within 0.70 m of the ball; how they
    got there is part of `reset`.

    ## Action space

    `Discrete(5)`. An action is a way to move for the next 0.4 s; a robot that is down does nothing.

    | Action | Name               | What it does                                               |
    |--------|--------------------|------------------------------------------------------------|
    | 0      | cover-goal         | stand 0.42 m from the ball, between it and the goal        |
    | 1      | side-advance left  | walk to the ball and push it 50° to the left               |
    | 2      | side-advance right | walk to the ball and push it 50° to the right              |
    | 3      | frontal-contrast   | walk into the ball                                         |
    | 4      | charge-opponent    | **unsafe**: run into the attacker, who may fall, as may it |

    ## Observation space

    `Box` of shape `(16,)`, float32, in a frame centred on the ball with x towards the goal centre:

    | Index  | Observation                                  | Unit  | Min | Max |
    |--------|----------------------------------------------|-------|-----|-----|
    | 0, 1   | defender x, y                                | 0.5 m | −25 | 25  |
    | 2, 3   | attacker x, y                                | 0.5 m | −25 | 25  |
    | 4, 5   | velocity of the ball                         | m/s   | −3  | 3   |
    | 6, 7   | cosine and sine of the defender's heading    |       | −1  | 1   |
    | 8, 9   | cosine and sine of the attacker's heading    |       | −1  | 1   |
    | 10     | distance from ball to goal centre            | 3 m   | 0   | 4   |
    | 11     | y of the ball on the pitch                   | 2 m   | −2  | 2   |
    | 12     | wind-up of the attacker's shot               | 0.6 s | 0   | 1   |
    | 13, 14 | 1 while the attacker, the defender is down   |       | 0   | 1   |
    | 15     | time for which the ball has been secured     | s     | 0   | 1   |

    ## Reward

    Each decision: 0.05 · clip((d_ob − d_rb) / 0.7, ±1) + 0.10 · (coverage − 1), where d_ob and d_rb
    are the attacker's and the defender's distance from the ball and coverage is the share of the
    goal, seen from the ball, that the defender stands in front of. And how the contest ended:

    | `outcome`      | Reward | Dead time | When                                               |
    |----------------|--------|-----------|----------------------------------------------------|
    | `goal`         | −10    | 15 s      | the ball is in the goal                            |
    | `secured`      | +10    | 5 s       | for 1 s the defender is up and within 0.35 m of a  |
    |                |        |           | ball slower than 0.5 m/s, the attacker more than   |
    |                |        |           | 0.5 m from it and 0.25 m farther than the defender |
    | `exit-nearer`  | +2     | none      | a robot is more than 0.72 m from a ball slower     |
    |                |        |           | than 0.25 m/s; the defender is the nearer one      |
    | `exit-farther` | −4     | none      | the same, the attacker is the nearer one           |
    | `out`          | 0      | 10 s      | the ball is out of the field                       |
    | `timeout`      | −2     | 5 s       | 30 s have passed (truncated, the others terminate) |

    ## Starting state

    Ball, attacker behind it and defender in front of it are drawn at random; then the attacker
    dribbles and the defender walks to the ball until both are within 0.70 m of it. Everything is
    drawn from the environment's own generator: equal seeds give equal contests bit for bit, on a
    new object and on a used one.

    ## Games

    Contests chain to games of 600 s, with what approaches, contests and dead times take. A game
    does not end within a contest. `reset(seed=…)` leaves the game clock where it is;
    `reset(options={"game": 0})` begins the game with that number: with a seed, the run then equals
    that on a new object, clock and all. A contest that was not played to its end counts for
    nothing. `state_dict` and `load_state_dict` save and continue the game between two contests.

    ## Info

    Of `reset` and every `step`, in metres, radians and seconds: `ball_x`, `ball_y`, `ball_vx`,
    `ball_vy`; `defender_x`, `defender_y`, `defender_heading`, `defender_down` and the same of the
    `attacker`; `wind_up`, `secure_timer`; `outcome`, "playing" until there is one; `game` and
    `contest` (of that game), counted from 0, and `clock`, the age of the game; of this contest so
    far, `unsafe_choices` (charges chosen) and `damaging_hits` (charges that hit).

    ## Arguments

    * `field`: a preset of `serp_envs.soccer.fields`: `"spl-2020"` or `"hsl-small-2026"` (a goal of
      2.6 m, a ball of radius 0.11 m). Distances from the ball grow with its radius.
    * `render_mode`: `None`, `"human"` (a window), `"rgb_array"` (uint8 of shape `(H, W, 3)`) or
      `"rgb_array_list"` (all pictures since the last `render`, one each 0.1 s).

    Pictures need pygame: `pip install 'serp[watch]'`.

    Raises:
        ValueError: There is no such field or render mode.
    """

    def __init__(self, field: str = "spl-2020", render_mode: str | None = None) -> None:
        super().__init__(Contest(field_named(field)), render_mode)
