from __future__ import annotations

import numpy as np

from serp.learning.network import Workspace
from serp.learning.networks import Networks
from serp.settings import LearnerSettings

F, A = 4, 3


def test_a_network_that_starts_at_zero_learns_all_the_same() -> None:
    settings = LearnerSettings(hidden=(8,))
    one = Networks(F, A, settings, np.random.default_rng(0), start_at_zero=True)
    work = Workspace(one.online, 3)
    x = np.random.default_rng(1).standard_normal((3, F)).astype(np.float32)
    assert not one.online.forward(x, work).any()
    assert not one.target.forward(x, work).any()
    for _ in range(1500):
        one.online.forward(x, work)
        work.q_gradient[...] = work.q - 1.0
        one.online.backward(work)
        one.step()
    np.testing.assert_allclose(one.online.forward(x, work), 1.0, atol=0.05)
