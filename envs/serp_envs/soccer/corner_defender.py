"""The corner kick that the SErP paper's section 5 names, as a Gymnasium environment."""

from __future__ import annotations

from serp_envs.soccer.corner_kick import CornerKick
from serp_envs.soccer.environment import SoccerEnv
from serp_envs.soccer.fields import field_named


class CornerKickDefender(SoccerEnv):
    """A robot defends its goal against a corner kick.

    ## Description

    The world, the robots and the attacker's way to shoot are those of `SoccerDefender`. A robot
    stands at a corner of the defended side and, after 1 to 3 s, kicks the ball to the near post, to
    the far post or to the penalty spot. The attacker waits near that place, runs to meet the ball,
    and then dribbles and shoots as ever. The defender marks a post or the attacker until it is
    clear where the ball goes, meets it or not, and kicks it away.

    An episode is one corner, from either side.

    ## Action space

    `Discrete(6)`. An action is a way to move for the next 0.4 s; a robot that is down does nothing.

    | Action | Name            | What it does                                                  |
    |--------|-----------------|---------------------------------------------------------------|
    | 0      | mark-near-post  | stand before the post on the corner's side                    |
    | 1      | mark-far-post   | stand before the other post                                   |
    | 2      | mark-attacker   | stand 0.45 m from the attacker, between it and the goal       |
    | 3      | intercept       | walk to where the rolling ball can be met first               |
    | 4      | clear           | walk to the ball and kick it away from the goal, 1.1 m/s      |
    | 5      | charge-opponent | **unsafe**: run into the attacker, who may fall, as may it    |

    ## Observation space

    `Box` of shape `(17,)`, float32, from the middle of the goal: x up the pitch, y to the side of
    the corner, so that the observations of both corners are equal:

    | Index  | Observation                                  | Unit  | Min | Max |
    |--------|----------------------------------------------|-------|-----|-----|
    | 0, 1   | defender x, y                                | 2 m   | −6  | 6   |
    | 2, 3   | attacker x, y                                | 2 m   | −6  | 6   |
    | 4, 5   | ball x, y                                    | 2 m   | −6  | 6   |
    | 6, 7   | velocity of the ball                         | m/s   | −3  | 3   |
    | 8, 9   | cosine and sine of the defender's heading    |       | −1  | 1   |
    | 10, 11 | cosine and sine of the attacker's heading    |       | −1  | 1   |
    | 12     | 1 once the corner has been taken             |       | 0   | 1   |
    | 13     | wind-up of the attacker's shot               | 0.6 s | 0   | 1   |
    | 14, 15 | 1 while the attacker, the defender is down   |       | 0   | 1   |
    | 16     | time for which the ball has been secured     | s     | 0   | 1   |

    ## Reward

    Each decision after the kick: 0.10 · (coverage − 1), where coverage is the share of the goal,
    seen from the ball, that the defender stands in front of. And how the corner ended:

    | `outcome` | Reward | Dead time | When                                                       |
    |-----------|--------|-----------|------------------------------------------------------------|
    | `goal`    | −10    | 15 s      | the ball is in the goal                                    |
    | `cleared` | +10    | 5 s       | a ball kicked last by the defender is 2.8 m from the goal  |
    | `secured` | +10    | 5 s       | as in `SoccerDefender`                                     |
    | `out`     | −2     | 10 s      | the ball is out of the field                               |
    | `timeout` | −2     | 5 s       | 30 s have passed (truncated, the others terminate)         |

    ## Info

    As in `SoccerDefender`, with the poses of the `kicker` too; `corner`, +1 for one on the
    defender's left and −1 for one on its right; `kicked`, whether it has been taken. Games,
    rendering and arguments are those of `SoccerDefender` too.

    ## How hard it is

    Means over 6,000 corners on `spl-2020` (standard error of a return at most 0.10):

    | Policy                                              | Return | Goals | Won  | Decisions |
    |-----------------------------------------------------|--------|-------|------|-----------|
    | stand still                                         | −11.3  | 95 %  | 0 %  | 23        |
    | random over all six                                 | −5.4   | 51 %  | 23 % | 30        |
    | always mark-near-post                               | −8.7   | 82 %  | 12 % | 24        |
    | always mark-far-post                                | −10.9  | 96 %  | 2 %  | 20        |
    | always mark-attacker                                | −9.8   | 77 %  | 1 %  | 29        |
    | always intercept                                    | 3.2    | 14 %  | 58 % | 20        |
    | always clear                                        | 4.1    | 15 %  | 68 % | 18        |
    | always charge-opponent                              | −8.4   | 15 %  | 6 %  | 65        |
    | mark the attacker until the kick, then intercept,   | 6.4    | 5 %   | 82 % | 21        |
    | clear within 0.5 m of the ball                      |        |       |      |           |

    Won are cleared and secured balls. A corner that is always won returns about +9.

    Raises:
        ValueError: There is no such field or render mode.
    """

    def __init__(self, field: str = "spl-2020", render_mode: str | None = None) -> None:
        super().__init__(CornerKick(field_named(field)), render_mode)
