"""What is learned from: by the task, or as the user sets it."""

from __future__ import annotations

from pathlib import Path

import pytest

from serp.errors import SettingsError
from serp.runs.trainer import Trainer
from serp.settings import resolve
from serp.tasks.task import Task
from tests.serp.sample_tasks import CORRIDOR, corridor

BONUS = 100.0
LEARNED = [("environment", "task"), ("environment", "domain"), ("environment", "sum"),
           ("domain", "task"), ("domain", "environment"), ("domain", "sum")]  # fmt: skip


def task_with_bonus(folder: Path, declared: str) -> Task:
    """The corridor, whose file gives 100 for waiting; its environment gives nothing for it."""
    begin = CORRIDOR.index("(:action wait")
    text = CORRIDOR[:begin] + CORRIDOR[begin:].replace(
        "(decrease (reward) 0.1)", f"(increase (reward) {BONUS:g})", 1
    )
    file = folder / "corridor.pddl"
    file.write_text(text)
    return corridor(folder, domain=file, reward=declared)


@pytest.mark.parametrize(("declared", "learned"), LEARNED)
def test_the_experts_reward_is_remembered_where_it_is_learned_from(
    tmp_path: Path, declared: str, learned: str
) -> None:
    task = task_with_bonus(tmp_path, declared)
    asked = {"training": {"reward": learned}, "learner": {"n_step": 1}}
    trainer = Trainer(task.bind(), resolve("default", task.settings, asked), 3)
    rows = [trainer.run_episode() for _ in range(3)]
    arrays, _ = trainer.agent.learner.replay.state_dict()
    remembered = arrays["reward"]
    assert len(remembered) == trainer.env_steps
    source = declared if learned == "task" else learned
    by_environment, by_domain = (
        sum(row.return_ for row in rows), sum(row.domain_return or 0.0 for row in rows)
    )  # fmt: skip
    assert by_domain > BONUS  # the planner goes by it whatever the learner learns from
    expected = {
        "environment": by_environment,
        "domain": by_domain,
        "sum": by_environment + by_domain,
    }
    assert sum(remembered) == pytest.approx(expected[source], rel=1e-5)
    assert (max(remembered) > 0.9 * BONUS) == (source != "environment")


def test_rewards_that_the_file_does_not_give_cannot_be_learned_from(tmp_path: Path) -> None:
    text = CORRIDOR.replace("(decrease (reward) 0.1)", "").replace("(decrease (reward) 5)", "")
    file = tmp_path / "silent.pddl"
    file.write_text(text.replace("(increase (reward) 5)", ""))
    task = corridor(tmp_path, domain=file)
    for learned in ("domain", "sum"):
        settings = resolve("default", task.settings, {"training": {"reward": learned}})
        with pytest.raises(SettingsError, match=f"reward is {learned}, but the domain of task"):
            Trainer(task.bind(), settings, 0)
    with pytest.raises(SettingsError, match="'environment' or 'sum', not 'both'"):
        resolve("default", task.settings, {"training": {"reward": "both"}})
