"""What a gradient update and a forward pass of the learner cost, beside two other ways.

    python tests/benchmarks/bench_learner.py [--rounds N]

Measures, in µs, one update (batch 64, network 64-64, 8 inputs, 3 actions, Adam, one core) and the
Q-values of one input:

* serp: `DQN.learn` and `DQN.q_values`, in several settings;
* plain torch: the same double DQN with `torch.nn.Sequential`, autograd and `torch.optim.Adam`;
* stable-baselines3: `DQN.train` and the Q-network's forward pass, if it is installed.

All take turns in short rounds, so that a busy machine slows all alike; medians and ratios to
stable-baselines3 (or to plain torch without it) are printed. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import os
import statistics
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
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


@dataclass
class Candidate:
    """Two things to time; `updates` and `forwards` collect seconds of single calls."""

    name: str
    update: Callable[[], Any]
    forward: Callable[[], Any]
    updates: list[float] = field(default_factory=list)
    forwards: list[float] = field(default_factory=list)


def transitions() -> list[tuple[Any, ...]]:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((FILLED + 1, INPUTS)).astype(np.float32)
    return [
        (x[i], int(rng.integers(ACTIONS)), float(rng.standard_normal()), x[i + 1], i % 50 == 49)
        for i in range(FILLED)
    ]


def serp(name: str, **settings: Any) -> Candidate:
    agent = DQN(
        INPUTS, ACTIONS, LearnerSettings(hidden=HIDDEN, batch_size=BATCH, **settings), seed=0
    )
    for x, action, reward, next_x, terminated in transitions():
        agent.remember(x, action, reward, next_x, terminated, False)
    x = np.ones(INPUTS, np.float32)
    return Candidate(f"serp, {name}", agent.learn, lambda: agent.q_values(x))


def plain_torch() -> Candidate:
    """The textbook way, as `serp, double DQN` does it."""

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
    one = np.ones(INPUTS, np.float32)

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

    @torch.no_grad()
    def forward() -> Any:
        return online(torch.from_numpy(one)[None])[0].numpy()

    return Candidate("plain torch, double DQN", update, forward)


def stable_baselines3() -> Candidate:
    import gymnasium
    from stable_baselines3 import DQN as TheirDQN
    from stable_baselines3.common.logger import Logger

    class Nothing(gymnasium.Env[np.ndarray, np.int64]):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (INPUTS,), np.float32)
        action_space = gymnasium.spaces.Discrete(ACTIONS)

    agent = TheirDQN(
        "MlpPolicy",
        Nothing(),
        batch_size=BATCH,
        buffer_size=50_000,
        policy_kwargs={"net_arch": list(HIDDEN)},
        device="cpu",
        seed=0,
    )
    agent.set_logger(Logger(None, []))
    for x, action, reward, next_x, terminated in transitions():
        agent.replay_buffer.add(
            x[None],
            next_x[None],
            np.array([[action]]),
            np.array([reward]),
            np.array([terminated]),
            [{}],
        )
    one = np.ones(INPUTS, np.float32)

    @torch.no_grad()
    def forward() -> Any:
        return agent.q_net(torch.from_numpy(one)[None])[0].numpy()

    return Candidate(
        "stable-baselines3 DQN", lambda: agent.train(gradient_steps=1, batch_size=BATCH), forward
    )


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

    candidates = [
        serp("paper", target_period=None, double=False, n_step=1, clip_targets=False),
        serp("target network", double=False),
        serp("double DQN"),
        serp("double DQN, LayerNorm", layer_norm=True),
        serp("double DQN, 5 members", members=5),
        serp("double DQN, LayerNorm, 5 members", members=5, layer_norm=True),
        plain_torch(),
    ]
    if find_spec("stable_baselines3") is None:
        print("stable-baselines3 is not installed; ratios are to plain torch")
    else:
        candidates.append(stable_baselines3())

    for candidate in candidates:
        timed(candidate.update, 20)  # compiles, fills caches
        timed(candidate.forward, 20)
    for _ in range(rounds):
        for candidate in candidates:
            candidate.updates.append(timed(candidate.update, 25))
            candidate.forwards.append(timed(candidate.forward, 50))

    reference = candidates[-1]
    print(f"{'':36}{'update µs':>10}{'times':>8}{'forward µs':>12}{'times':>8}")
    for c in candidates:
        update, forward = map(statistics.median, (c.updates, c.forwards))
        print(
            f"{c.name:36}{update * 1e6:10.1f}{statistics.median(reference.updates) / update:8.1f}"
            f"{forward * 1e6:12.1f}{statistics.median(reference.forwards) / forward:8.1f}"
        )
    print(f"times: as many times faster than {reference.name}, medians of {rounds} rounds")


if __name__ == "__main__":
    main()
