from __future__ import annotations

import numpy as np
import pytest
import torch

from serp.learning.q_learning import Adam


@pytest.mark.parametrize("largest_norm", [None, 0.5])
@pytest.mark.parametrize("members", [1, 3])
def test_equals_torch(members: int, largest_norm: float | None) -> None:
    rng = np.random.default_rng(0)
    start = rng.standard_normal((members, 200)).astype(np.float32)
    parameters, gradient = torch.from_numpy(start.copy()), torch.zeros(members, 200)
    average = torch.zeros(members, 200)
    slow = average.clone()
    ours = Adam(
        *(t.numpy() for t in (parameters, gradient)), 0.01, largest_norm, average.numpy(), 0.1
    )
    theirs = [torch.nn.Parameter(torch.from_numpy(row.copy())) for row in start]
    optimizer = torch.optim.Adam(theirs, lr=0.01, fused=True)

    for step in range(100):
        size = 10.0 ** rng.uniform(-4, 1)
        gradient.copy_(torch.from_numpy(rng.standard_normal((members, 200)) * size))
        gradient[:, :20] = 0.0 if step % 7 else 1e-20
        for parameter, row in zip(theirs, gradient, strict=True):
            parameter.grad = row.clone()
            if largest_norm is not None:
                torch.nn.utils.clip_grad_norm_([parameter], largest_norm)
        optimizer.step()
        ours.step()
        expected = torch.stack([p.detach() for p in theirs])
        torch.testing.assert_close(parameters, expected, rtol=1e-5, atol=1e-5)
        slow.lerp_(parameters, 0.1)
        torch.testing.assert_close(average, slow, rtol=1e-5, atol=1e-5)
