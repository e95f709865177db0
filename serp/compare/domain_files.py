"""Which domain files `model_variants` means."""

from __future__ import annotations

import glob
from collections.abc import Iterable
from pathlib import Path

from serp._util.text import did_you_mean
from serp.errors import TaskError


def domain_files(asked: Iterable[str | Path], task: str, beside: Path) -> list[Path]:
    """Return the files that are meant, in order, each once.

    Args:
        asked: Files, names of files beside the task's own domain file (`cartpole-reversed`),
            patterns of either, or `all`: every file there that is named like the task and a
            hyphen.
        task: Name of the task.
        beside: The task's own domain file.

    Raises:
        TaskError: Nothing is there under a name or a pattern.
    """
    folder = beside.parent
    found: dict[Path, None] = {}
    for name in map(str, asked):
        if name == "all":
            matches = sorted(folder.glob(f"{glob.escape(task)}-*.pddl"))
        elif glob.has_magic(name):
            matches = sorted(map(Path, glob.glob(name))) or sorted(folder.glob(_with_suffix(name)))
        else:
            places = (Path(name), folder / _with_suffix(name))
            matches = [path for path in places if path.is_file()][:1]
        matches = [path for path in matches if not path.name.endswith("-problem.pddl")]
        if not matches:
            known = sorted(path.stem for path in folder.glob("*.pddl") if path != beside)
            raise TaskError(f"there is no domain file {name}; {did_you_mean(name, known)}")
        found.update(dict.fromkeys(matches))
    return list(found)


def _with_suffix(name: str) -> str:
    return name if name.endswith(".pddl") else f"{name}.pddl"
