"""What a grounding takes: the observation, and info or the environment where it names them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.errors import TaskError
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.task import Task
from tests.serp.sample_tasks import Corridor, corridor


class Located(Corridor):
    """Says in its info where the robot is."""

    def info(self) -> dict[str, Any]:
        return {"x": self.x}


def located(folder: Path, ground: Callable[..., Any]) -> Task:
    return corridor(folder, Located, ground=ground)


def of_both(seen: Any, *, env: Located, info: dict[str, Any]) -> dict[str, float]:
    assert env.x == info["x"] == seen[0]
    return {"x": info["x"]}


def test_a_grounding_of_info_or_of_the_environment_trains_as_one_of_the_observation(
    tmp_path: Path,
) -> None:
    """Also where an episode ends and the next begins: no info is used a step too late."""
    weights = []
    for ground in (
        lambda seen: {"x": seen[0]},
        lambda seen, info: {"x": info["x"]},
        lambda seen, env: [env.unwrapped.x],
        of_both,
    ):
        task = located(tmp_path, ground)
        trainer = Trainer(task.bind(), resolve("default", task.settings), 3)
        rows = [trainer.run_episode() for _ in range(4)]
        weights.append((trainer.agent.learner.state_dict()[0], [row.return_ for row in rows]))
    (expected, returns), *others = weights
    for arrays, others_returns in others:
        assert others_returns == returns
        assert all(np.array_equal(arrays[name], expected[name]) for name in expected)


@pytest.mark.parametrize(
    ("ground", "said"),
    [
        (lambda seen, infos: {}, r"ground\(seen, infos\) cannot be called: .*`infos?`"),
        (lambda: {}, r"ground\(\) cannot be called: too many positional"),
        (lambda seen, info: info["place"], r"failed on .*KeyError: 'place'"),
        (lambda seen, info: {"y": 1.0}, "does not fit .*: no value for fluent `x`|unknown fluent"),
    ],
)
def test_one_that_does_not_fit_is_named_when_the_task_is_bound(
    tmp_path: Path, ground: Callable[..., Any], said: str
) -> None:
    with pytest.raises(TaskError, match=said):
        located(tmp_path, ground).bind()
