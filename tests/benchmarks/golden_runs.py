"""Golden runs: does a change of the code change what it computes?

    python tests/benchmarks/golden_runs.py before   # with the code of before
    python tests/benchmarks/golden_runs.py after    # with the code of after
    diff -r before/golden after/golden

Trains every shipped task with every preset (seed 0), evaluates, plans, checks, diagnoses and
repairs, and makes one comparison of all algorithms. `golden` has a file for every table, checkpoint
and report, without times and names of tensors. A few minutes on one core.
"""

from __future__ import annotations

import csv
import hashlib
import os
import subprocess
import sys
from pathlib import Path

from safetensors import safe_open

TASKS = {"cartpole": 1500, "cliff": 1500, "corner-kick": 900, "hill": 1500, "landing": 1500,
         "soccer": 1500, "swing-up": 1500}  # fmt: skip
ALGORITHMS = "serp,serp-paper,mrp,dqn,dqn-paper,sb3-dqn,ppo"
TIMES = ("time", "seconds", "per_second")


def serp(*arguments: object) -> str:
    """Run the command; return what it prints, without times."""
    environment = {**os.environ, "COLUMNS": "140", "OMP_NUM_THREADS": "1"}
    line = [sys.executable, "-m", "serp", *map(str, arguments)]
    done = subprocess.run(line, capture_output=True, text=True, env=environment, check=False)
    lines = done.stdout.splitlines()
    return "\n".join(line for line in lines if not any(word in line for word in TIMES))


def table(path: Path) -> str:
    """Return a table without its columns of times."""
    head, *rows = list(csv.reader(path.open(newline="")))
    columns = [k for k, name in enumerate(head) if not any(word in name for word in TIMES)]
    return "\n".join(",".join(row[k] for k in columns) for row in (head, *rows))


def tensors(path: Path) -> str:
    with safe_open(path, framework="np") as saved:
        every = [saved.get_tensor(name) for name in saved.keys()]  # noqa: SIM118
    digests = (hashlib.sha256(one.tobytes()).hexdigest()[:16] for one in every)
    return "\n".join(
        sorted(f"{a.dtype}{list(a.shape)} {d}" for a, d in zip(every, digests, strict=True))
    )


def record(folder: Path) -> None:
    golden = folder / "golden"
    golden.mkdir(parents=True)

    def write(name: str, text: str) -> None:
        (golden / name).write_text(text.replace(str(folder), "FOLDER") + "\n")

    for task, steps in TASKS.items():
        for preset in ("default", "paper"):
            run = folder / f"{task}-{preset}"
            serp("plan-and-learn", "--domain", task, "--preset", preset, "--seed", 0,
                 "--env-steps", steps, "--out", run, "--quiet")  # fmt: skip
            newest = max(run.rglob("*.safetensors"), key=lambda path: path.stat().st_mtime)
            write(f"{run.name}-tensors", tensors(newest))
            for name in ("metrics.csv", "decisions.csv"):
                write(f"{run.name}-{name}", table(run / name))
        run, repaired = folder / f"{task}-default", folder / f"{task}.pddl"
        for policy in ("serp", "planner", "learner"):
            arguments = ("--policy", policy, "--episodes", 3, "--json")
            write(f"{task}-evaluate-{policy}", serp("evaluate", run, *arguments))
        serp("repair", run, "-o", repaired)
        write(f"{task}-repaired", repaired.read_text() if repaired.exists() else "")
        write(f"{task}-diagnose", serp("diagnose", run))
        write(f"{task}-check", serp("check", task))
        write(f"{task}-plan", serp("plan", "--domain", task, "--observe", "--seed", 3))
    serp("compare", "--domain", "cartpole", "--algorithms", ALGORITHMS, "--seeds", 2,
         "--env-steps", 600, "--evaluate-every", 300, "--evaluation-episodes", 2,
         "--final-episodes", 3, "--jobs", 1, "--out", folder / "compare")  # fmt: skip
    for path in (folder / "compare").rglob("*.csv"):
        write("-".join(path.relative_to(folder).parts), table(path))


if __name__ == "__main__":
    record(Path(sys.argv[1]))
