"""Settings of the correction of the transition model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from serp._util.numbers import COUNTED, whole
from serp.errors import SettingsError

MODES = ("off", "literals", "residual", "full")


@dataclass(frozen=True, kw_only=True)
class AdaptationSettings:
    """What is made of the model's one-step errors.

    Attributes:
        mode: `off`: they are recorded, nothing else; `literals`: the numbers of effects and rates
            are estimated anew; `residual`: what the file does not say is learned beside it;
            `full`: both.
        nonlinear: Whether a residual may use random Fourier features where a linear one leaves
            something unexplained.
        tries: In its turn, in training, the planner prefers an action that it has seen fewer times
            than that, where it is predicted safe for the whole lookahead, or where nothing is, for
            the next step; 0, or mode `off`: never.
    """

    mode: Literal["off", "literals", "residual", "full"] = "off"
    nonlinear: bool = True
    tries: int = 0

    def __post_init__(self) -> None:
        if self.mode not in MODES:
            raise SettingsError(f"correction: mode must be {' or '.join(MODES)}, not {self.mode!r}")
        if not isinstance(self.nonlinear, bool):
            raise SettingsError(
                f"correction: nonlinear must be true or false, not {self.nonlinear!r}"
            )
        tries = whole(self.tries, 0, COUNTED)
        if tries is None:
            raise SettingsError(
                f"correction: tries must be a whole number from 0 to 2^53, not {self.tries!r}"
            )
        object.__setattr__(self, "tries", tries)

    @property
    def residual(self) -> bool:
        """Whether a residual is learned."""
        return self.mode in ("residual", "full")

    @property
    def literals(self) -> bool:
        """Whether literals are estimated anew."""
        return self.mode in ("literals", "full")
