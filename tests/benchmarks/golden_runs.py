"""Golden runs: does a change of the code change what it computes?

    python tests/benchmarks/golden_runs.py record before   # with the code of before
    python tests/benchmarks/golden_runs.py record after    # with the code of after
    python tests/benchmarks/golden_runs.py compare before after

`record` trains every shipped task with every preset (seed 0), evaluates, plans, checks, diagnoses
and repairs, and makes one comparison of all algorithms. `compare` lists every column of a table,
every tensor of a checkpoint and every line of a report that differs. Times are left out, and names
of tensors: those are compared as a set. A few minutes on one core.
"""

from __future__ import annotations

import csv
import difflib
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from safetensors import safe_open

TASKS = {"cartpole": 1500, "cliff": 1500, "corner-kick": 900, "hill": 1500, "landing": 1500,
         "soccer": 1500, "swing-up": 1500}  # fmt: skip
POLICIES = ("serp", "planner", "learner", "training")
ALGORITHMS = "serp,serp-paper,mrp,dqn,dqn-paper,sb3-dqn,ppo"
TIMES = ("time", "seconds", "per_second")


def serp(*arguments: object) -> str:
    """Run the command; return what it prints."""
    environment = {**os.environ, "COLUMNS": "140", "OMP_NUM_THREADS": "1"}
    line = [sys.executable, "-m", "serp", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, env=environment, check=False).stdout


def digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def columns(path: Path) -> dict[str, Any]:
    """Return a digest of each column of a table."""
    head, *rows = list(csv.reader(path.open(newline="")))
    return {name: digest("\n".join(row[i] for row in rows).encode()) for i, name in enumerate(head)}


def tensors(path: Path) -> list[str]:
    with safe_open(path, framework="np") as saved:
        every = [saved.get_tensor(name) for name in saved.keys()]  # noqa: SIM118
    return sorted(f"{one.dtype}{list(one.shape)} {digest(one.tobytes())}" for one in every)


def record_run(folder: Path, task: str, preset: str) -> dict[str, Any]:
    run = folder / f"{task}-{preset}"
    serp("plan-and-learn", "--domain", task, "--preset", preset, "--seed", 0,
         "--env-steps", TASKS[task], "--out", run, "--quiet")  # fmt: skip
    newest = max(run.rglob("*.safetensors"), key=lambda path: path.stat().st_mtime)
    found: dict[str, Any] = {
        "metrics.csv": columns(run / "metrics.csv"),
        "decisions.csv": columns(run / "decisions.csv"),
        "tensors": tensors(newest),
        "summary": json.loads((run / "summary.json").read_text()),
    }
    if preset == "default":
        for policy in POLICIES:
            arguments = ("--policy", policy, "--episodes", 3, "--json")
            found[f"evaluate {policy}"] = serp("evaluate", run, *arguments)
        repaired = folder / f"{task}.pddl"
        serp("repair", run, "-o", repaired)
        found["repaired"] = repaired.read_text() if repaired.exists() else ""
        found["diagnose"] = serp("diagnose", run)
        found["check"] = serp("check", task)
        found["plan"] = serp("plan", "--domain", task, "--observe", "--seed", 3)
    return found


def record(folder: Path) -> None:
    folder.mkdir(parents=True)
    found = {
        f"{task}-{preset}": record_run(folder, task, preset)
        for task in TASKS
        for preset in ("default", "paper")
    }
    serp("compare", "--domain", "cartpole", "--algorithms", ALGORITHMS, "--seeds", 2,
         "--env-steps", 600, "--evaluate-every", 300, "--evaluation-episodes", 2,
         "--final-episodes", 3, "--jobs", 1, "--out", folder / "compare")  # fmt: skip
    tables = sorted((folder / "compare").rglob("*.csv"))
    found["compare"] = {str(path.relative_to(folder)): columns(path) for path in tables}
    text = json.dumps(found, indent=1).replace(str(folder), "FOLDER")
    (folder / "golden.json").write_text(text)


def leaves(value: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from leaves(inner, f"{place}/{name}")
    else:
        yield place, value


def compare(before: Path, after: Path) -> int:
    """Print what differs; return how many things do."""
    old, new = (dict(leaves(json.loads((f / "golden.json").read_text()))) for f in (before, after))
    different = 0
    for place in sorted({*old, *new}):
        one, other = old.get(place), new.get(place)
        if one == other or any(word in place for word in TIMES):
            continue
        different += 1
        print(place)
        if isinstance(one, str) and isinstance(other, str) and "\n" in one:
            lines = difflib.unified_diff(one.split("\n"), other.split("\n"), lineterm="", n=0)
            print("\n".join(f"    {line}" for line in list(lines)[2:]))
        else:
            print(f"    {one}\n    {other}")
    print(f"{different} of {len(old)} differ")
    return different


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["record", folder]:
            record(Path(folder))
        case ["compare", before, after]:
            sys.exit(bool(compare(Path(before), Path(after))))
        case _:
            sys.exit(__doc__)
