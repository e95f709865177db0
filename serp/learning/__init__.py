"""The learner: a DQN for small dense networks on one CPU core (paper section 3.3).

=============  =======================================================================
``settings``   `LearnerSettings`: every choice, with its range
``network``    `QNetwork`: parameters in one flat tensor, forward and backward pass
``kernels``    the compiled loops of both passes, of the TD loss and of Adam
``adam``       `Adam` on that tensor
``samples``    `Samples`: what is remembered, side by side in arrays
``replay``     `ReplayBuffer`: n-step samples, masks, protected memory
``sampling``   `Sampler`: batches from it
``td``         `TDGradient`: from a batch to the gradient of the loss
``guidance``   `Guidance`, `GuidedLearning`: learning from a guide
``guided_kernels``  the compiled loops of that
``bounds``     `ReturnBounds`: between which values a return can lie
``schedule``   `LinearSchedule`: exploration over time
``symmetry``   `SymmetryGroup`: mirror images of inputs and actions
``mean_q``     `MeanQ`: Q over members and mirror images
``networks``   `Networks`: what a gradient update changes
``dqn``        `DQN`: proposes, remembers, learns; `Proposal`
=============  =======================================================================

The names below are imported on first use, so that torch is loaded only where something learns.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from serp.learning.dqn import DQN, Proposal
    from serp.learning.guidance import Guidance, GuidedLearning
    from serp.learning.replay import ReplayBuffer

__all__ = [
    "DQN",
    "Guidance",
    "GuidedLearning",
    "Proposal",
    "ReplayBuffer",
]

_HOME = {
    "DQN": "serp.learning.dqn",
    "Guidance": "serp.learning.guidance",
    "GuidedLearning": "serp.learning.guidance",
    "Proposal": "serp.learning.dqn",
    "ReplayBuffer": "serp.learning.replay",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_HOME))
