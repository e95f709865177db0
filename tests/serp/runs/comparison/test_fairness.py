"""Whether domain files judge what is observed alike."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from serp.runs.comparison.compare import judges_alike
from serp.tasks.registry import load_task
from tests.serp.runs.comparison.contest import Walk, walk
from tests.serp.runs.comparison.test_prepared import prepared
from tests.serp.sample_tasks import CORRIDOR

DIFFERENT = {
    "fast": (CORRIDOR.replace("increase (x) 1", "increase (x) 3"), None),  # predicts, judges alike
    "cheap": (CORRIDOR.replace("decrease (reward) 0.1", "decrease (reward) 0.2"), "rewards"),
    "bold": (CORRIDOR.replace("(unsafe) (terminal) ", "(terminal) "), "flags unsafe"),
    "unknown": (CORRIDOR.replace("(:action wait", "(:action rest"), "rewards"),
}


def notes(folder: Path, text: str, learned: str = "task", **changes: Any) -> list[str]:
    other = folder / "other.pddl"
    other.write_text(text)
    task = walk(folder, **changes)
    variants = {"walk": task, "other": walk(folder, **{**changes, "domain": other})}
    with task.bind() as bound:
        asked = {"training": {"reward": learned}}
        return judges_alike(prepared(folder, tasks=variants, changes=asked), bound)


@pytest.mark.parametrize("name", list(DIFFERENT))
def test_what_is_judged_unlike_is_said(tmp_path: Path, name: str) -> None:
    text, what = DIFFERENT[name]
    found = notes(tmp_path, text)
    if what is None:
        assert found == []
    else:
        (note,) = found
        assert f"The domain file `other` {what} other steps than `walk` does" in note


def test_another_reward_is_no_matter_where_the_environments_is_learned_from(
    tmp_path: Path,
) -> None:
    assert notes(tmp_path, DIFFERENT["cheap"][0], reward="environment") == []
    assert notes(tmp_path, DIFFERENT["cheap"][0], "environment") == []
    assert len(notes(tmp_path, DIFFERENT["cheap"][0], "sum", reward="environment")) == 1
    assert len(notes(tmp_path, DIFFERENT["bold"][0], reward="environment")) == 1


def test_the_order_of_fluents_and_actions_in_the_file_is_no_matter(tmp_path: Path) -> None:
    two = CORRIDOR.replace("(x) (reward)", "(x) (y) (reward)")
    two = two.replace("(>= (x) 4)", "(>= (+ (x) (* 0 (y))) 4)")
    (tmp_path / "corridor.pddl").write_text(two)
    turned = two.replace("(x) (y) (reward)", "(y) (x) (reward)")
    begin, end = turned.index("(:action left"), turned.index("(:action right")
    left, rest = turned[begin:end], turned[end:]
    cut = rest.index("(:action wait")
    turned = turned[:begin] + rest[:cut] + left + rest[cut:]
    ground: Any = lambda seen: {"x": seen[0], "y": seen[1]}  # noqa: E731
    actions = {"left": 0, "right": 1, "wait": 2}
    assert notes(tmp_path, turned, ground=ground, actions=actions) == []
    worse = turned.replace("decrease (reward) 5", "decrease (reward) 6")
    assert len(notes(tmp_path, worse, ground=ground, actions=actions)) == 1


def test_an_environment_that_reuses_its_buffer_is_judged_all_the_same(tmp_path: Path) -> None:
    class Reusing(Walk):
        def seen(self) -> Any:
            if not hasattr(self, "buffer"):
                self.buffer = super().seen()
            self.buffer[:] = super().seen()
            return self.buffer

    jump = CORRIDOR.replace(
        "(:event pit", "(:event far :parameters () :precondition (and (>= (x) 2)) "
        ":effect (and (unsafe)))\n  (:event pit"
    )  # fmt: skip
    assert len(notes(tmp_path, jump, make_env=Reusing)) == 1
    assert notes(tmp_path, CORRIDOR, make_env=Reusing) == []


def test_the_shipped_variants_are_on_equal_terms(tmp_path: Path) -> None:
    task = load_task("cartpole")
    folder = Path(__file__).parents[4] / "domains"
    variants = {"cartpole": task}
    for file in sorted(folder.glob("cartpole-*.pddl")):
        variants[file.stem] = dataclasses.replace(task, domain=file)
    assert len(variants) == 6

    with task.bind() as bound:
        assert judges_alike(prepared(tmp_path, tasks=variants), bound) == []
