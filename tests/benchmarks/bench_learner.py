"""What a gradient update of the learner costs, beside plain torch.

    python tests/benchmarks/bench_learner.py [--rounds N]

Measures, in µs, one update (batch 64, network 64-64, 8 inputs, 3 actions, Adam, one core) of
`DQN.learn` in several settings, and of the same double DQN with `torch.nn.Sequential`, autograd and
`torch.optim.Adam`. All take turns in short rounds, so that a busy machine slows all alike; medians
and ratios to plain torch are printed. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import statistics
from collections.abc import Callable
from itertools import pairwise
from time import perf_counter
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import torch

from serp.learning.dqn import DQN
from serp.settings import LearnerSettings

INPUTS, ACTIONS, BATCH, HIDDEN = 8, 3, 64, (64, 64)
FILLED = 2000


def transitions() -> list[tuple[Any, ...]]:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((FILLED + 1, INPUTS)).astype(np.float32)
    return [
        (x[i], int(rng.integers(ACTIONS)), float(rng.standard_normal()), x[i + 1], i % 50 == 49)
        for i in range(FILLED)
    ]


def serp(**settings: Any) -> Callable[[], Any]:
    agent = DQN(
        INPUTS, ACTIONS, LearnerSettings(hidden=HIDDEN, batch_size=BATCH, **settings), seed=0
    )
    for x, action, reward, next_x, terminated in transitions():
        agent.remember(x, action, reward, next_x, terminated, False)
    return agent.learn


def plain_torch() -> Callable[[], Any]:
    """The textbook way, as `double DQN` does it."""

    def network() -> torch.nn.Sequential:
        sizes = (INPUTS, *HIDDEN, ACTIONS)
        layers: list[torch.nn.Module] = []
        for n, m in pairwise(sizes):
            layers += [torch.nn.Linear(n, m), torch.nn.ReLU()]
        return torch.nn.Sequential(*layers[:-1])

    online, target = network(), network()
    target.load_state_dict(online.state_dict())
    optimizer = torch.optim.Adam(online.parameters(), lr=0.001)
    memory = transitions()
    x, next_x = (torch.from_numpy(np.stack([t[i] for t in memory])) for i in (0, 3))
    action = torch.tensor([t[1] for t in memory])[:, None]
    reward = torch.tensor([t[2] for t in memory])
    going_on = torch.tensor([not t[4] for t in memory], dtype=torch.float32)

    def update() -> float:
        i = torch.randint(FILLED, (BATCH,))
        with torch.no_grad():
            best = online(next_x[i]).argmax(1, keepdim=True)
            value = target(next_x[i]).gather(1, best)[:, 0]
            y = reward[i] + 0.97 * going_on[i] * value
        loss = torch.nn.functional.mse_loss(online(x[i]).gather(1, action[i])[:, 0], y)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(online.parameters(), 10.0)
        optimizer.step()
        return loss.item()

    return update


def timed(call: Callable[[], Any], count: int) -> float:
    start = perf_counter()
    for _ in range(count):
        call()
    return (perf_counter() - start) / count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--rounds", type=int, default=40)
    rounds = parser.parse_args().rounds
    torch.set_num_threads(1)

    updates = {
        "paper": serp(target_polyak=None, n_step=1, guarded_targets=False),
        "double DQN": serp(),
        "double DQN, LayerNorm": serp(layer_norm=True),
        "double DQN, 5 members": serp(members=5),
        "double DQN, LayerNorm, 5 members": serp(members=5, layer_norm=True),
        "plain torch, double DQN": plain_torch(),
    }
    seconds: dict[str, list[float]] = {name: [] for name in updates}
    for update in updates.values():
        timed(update, 20)  # compiles, fills caches
    for _ in range(rounds):
        for name, update in updates.items():
            seconds[name].append(timed(update, 25))
    reference = statistics.median(seconds["plain torch, double DQN"])
    for name, found in seconds.items():
        median = statistics.median(found)
        print(f"{name:36}{median * 1e6:8.1f} µs{reference / median:8.1f} times as fast as torch")


if __name__ == "__main__":
    main()
