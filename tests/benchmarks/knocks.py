"""Knocks for whole runs: SIGKILL at random moments, a full disk, and torn files.

Part of `tests.benchmarks.soak`, which says how it is started. Whatever happened to a run, going on
with it gives what an undisturbed run gives: the same records, network and model, bit by bit. A file
that is torn makes one clear line of whatever reads it, or changes no answer; nothing else is lost.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

from serp.runs.train import plan_and_learn
from serp.tasks.registry import find_task
from serp.tasks.task import Task
from serp.ui.root import exit_with, serp
from tests.benchmarks import soak
from tests.serp.runs.runs import everything, without_pictures

TASKS: Final = ("soccer", "soccer", "cliff", "cartpole", "frozen-lake", "taxi", "corner-kick")
"""Installed tasks of which a run is one; half of the runs are in random worlds."""
ENV_STEPS: Final = 1_500
KILLS: Final = 4
"""So often a run is killed before it may end."""
SECONDS: Final = 300
"""Nothing takes so long but what hangs."""
PARTS: Final = ("metrics", "decisions", "recording", "arrays", "values", "summary")
"""What is compared of two runs."""
_NUMBERS: Final = re.compile(r"\d+(\.\d+)? s\b|/tmp/\S+")


class Ended(NamedTuple):
    """How a process ended: its status, negative for a signal, and what it printed."""

    status: int
    text: str
    seconds: float


def apart(function: Callable[[], Any], killed_after: float | None = None) -> Ended:
    """Call a function in a process of its own, as a command of serp is; kill it after a while.

    Raises:
        soak.Fault: It hangs, or processes of it survive it.
    """
    sys.stdout.flush()
    with tempfile.TemporaryFile() as out:
        begun = time.monotonic()
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            for number in (1, 2):
                os.dup2(out.fileno(), number)
            sys.stdout, sys.stderr = (os.fdopen(n, "w") for n in (1, 2))
            status = 70
            try:
                exit_with(function)
            except SystemExit as stop:
                status = int(stop.code or 0)
            except BaseException:
                traceback.print_exc()
            finally:
                with contextlib.suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(status)
        while not (done := os.waitpid(child, os.WNOHANG))[0]:
            passed = time.monotonic() - begun
            if passed > SECONDS or (killed_after is not None and passed > killed_after):
                os.kill(child, signal.SIGKILL)
                done = os.waitpid(child, 0)
                break
            time.sleep(0.001)
        passed = time.monotonic() - begun
        out.seek(0)
        text = out.read().decode(errors="replace")
    _await_group(child)
    status = os.waitstatus_to_exitcode(done[1])
    if status == -signal.SIGKILL and killed_after is None:
        raise soak.Fault(f"it hangs: {text[-1000:]}")
    return Ended(status, text, passed)


def _await_group(group: int) -> None:
    """Wait until no process of a group is left: those of environments end with their training."""
    for _ in range(200):
        try:
            os.killpg(group, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    raise soak.Fault("environments of a training that was killed go on")


class Job(NamedTuple):
    """A training: its task, and its options for `plan_and_learn`."""

    task: Task
    options: dict[str, Any]
    seed: int

    @classmethod
    def drawn(cls, number: int, env_steps: int) -> Job:
        """Return a random job."""
        random = Random(number)
        world = None
        for k in range(number, number + 1000) if random.random() < 0.5 else ():
            world = soak.drawn(k)
            if world is not None and world.texts.domain.count("(:action") > 1:
                break
        name = random.choice(TASKS)
        changes = world.changes if world else soak.changes_of(random)
        changes["training"] |= {"num_envs": random.choice((1, 1, 2))}
        if not world:
            changes["training"]["episode_steps"] = 10_000
        return cls(
            world.task() if world else find_task(name),
            {
                "preset": random.choice(("default", "paper")), "settings": changes,
                "env_steps": env_steps, "seed": number,
            },
            number,
        )  # fmt: skip

    def __str__(self) -> str:
        return f"{self.task.name} {json.dumps(self.options)}"

    def run(self, out: Path, on_step: Any = None) -> None:
        """Begin the training, or go on with it."""
        with without_pictures():
            if (out / "config.json").exists():
                plan_and_learn(self.task, out=out, resume=True, quiet=True)
            else:
                plan_and_learn(self.task, out=out, quiet=True, on_step=on_step, **self.options)

    def judged(self, out: Path) -> None:
        """Make the whole training, every decision judged; write the counts beside it."""
        domain = self.task.bind()
        judge = soak.Judge(domain.domain, domain.model.dt)
        domain.close()
        self.run(out, lambda step: judge(step.state, step.decision, None))
        (out.parent / "counts").write_text(json.dumps(judge.counts))


@contextlib.contextmanager
def scratch() -> Iterator[Path]:
    """Yield an empty folder."""
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        yield Path(folder)


def left_by(run: Path) -> Any:
    """Return what a run left, but for its times."""
    summary = json.loads((run / "summary.json").read_text())
    for name in ("wall_time", "steps_per_second"):
        summary.pop(name, None)
    return dict(zip(PARTS, (*everything(run), summary), strict=True))


def whole(job: Job, folder: Path) -> tuple[Any, float, Counter[str]] | None:
    """Make the undisturbed run: what it left, its seconds, counts; None where it is refused."""
    ended = apart(lambda: job.judged(folder / "whole"))
    clean(ended, f"{job}")
    if ended.status:
        return None
    counts = Counter(json.loads((folder / "counts").read_text()))
    return left_by(folder / "whole"), ended.seconds, counts


def clean(ended: Ended, what: str) -> None:
    """Check that a command ended well, or with one message.

    Raises:
        soak.Fault: It did not.
    """
    errors = ended.text.count("Error: ")
    if "Traceback" in ended.text or ended.status not in (0, 1) or (ended.status and errors != 1):
        raise soak.Fault(f"{what}\nended with {ended.status}:\n{ended.text[-3000:]}")


def compare(job: Job, run: Path, expected: Any, what: str) -> None:
    """Check that a run left what is expected.

    Raises:
        soak.Fault: It did not.
    """
    left = left_by(run)
    if differing := [part for part in PARTS if left[part] != expected[part]]:
        kept = tempfile.mkdtemp(prefix="differs-")
        shutil.copytree(run, Path(kept) / "run")
        raise soak.Fault(f"{what}: {differing} of the run differ, see {kept}: {job}")


def kills(number: int) -> Counter[str]:
    """Kill a run at random moments, and go on with it."""
    random, job = Random(number), Job.drawn(number, ENV_STEPS)
    with scratch() as folder:
        made = whole(job, folder)
        if made is None:
            return Counter({"runs refused": 1})
        expected, seconds, counts = made
        for _ in range(KILLS):
            if apart(lambda: job.run(folder / "run"), random.uniform(0, seconds)).status == 0:
                break
            counts["kills"] += 1
        ended = apart(lambda: job.run(folder / "run"))
        clean(ended, f"after kills: {job}")
        if ended.status:
            raise soak.Fault(f"after kills: {ended.text[-1000:]} {job}")
        compare(job, folder / "run", expected, "after kills")
        return counts + Counter({"killed runs": 1})


@contextlib.contextmanager
def small_disk(folder: Path, size: int) -> Iterator[Callable[[int], None]]:
    """Make a folder a disk of so many bytes; yield what makes it larger. It takes root."""
    folder.mkdir()

    def mount(*options: str) -> None:
        subprocess.run(["mount", *options, str(folder)], check=True, capture_output=True)

    mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs")
    try:
        yield lambda larger: mount("-o", f"remount,size={larger}")
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def disk(number: int) -> Counter[str]:
    """Let a run meet a full disk, or a limit of the size of files, and go on with more room."""
    random, job = Random(number), Job.drawn(number, ENV_STEPS // 3)
    with scratch() as folder:
        made = whole(job, folder)
        if made is None:
            return Counter({"runs refused": 1})
        expected, _, counts = made
        files = [f.stat().st_size for f in (folder / "whole").rglob("*") if f.is_file()]
        mounted = os.geteuid() == 0 and random.random() < 0.7
        most = sum(files) + 4096 * len(files) if mounted else max(files)
        rooms = sorted(random.randint(0, most) // 4096 * 4096 + 4096 for _ in range(4))
        run = folder / "disk" / "run"
        with contextlib.ExitStack() as stack:
            if mounted:
                enlarge = stack.enter_context(small_disk(folder / "disk", rooms[0]))
            else:
                (folder / "disk").mkdir()

            def limited(room: int) -> None:
                if not mounted:
                    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
                    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
                job.run(run)

            for room in rooms:
                if mounted:
                    enlarge(room)
                ended = apart(lambda room=room: limited(room))  # type: ignore[misc]
                clean(ended, f"disk of {room} bytes, {mounted=}: {job}")
                counts["full disks"] += ended.status
            if mounted:
                enlarge(1 << 30)
            ended = apart(lambda: job.run(run))
            clean(ended, f"after {rooms}, {mounted=}: {job}")
            if ended.status:
                raise soak.Fault(f"after {rooms}, {mounted=}: {ended.text[-1000:]} {job}")
            compare(job, run, expected, f"after disks of {rooms}, {mounted=}")
        return counts + Counter({"runs on full disks": 1})


# Torn files ------------------------------------------------------------------------------------


def torn_content(random: Random, data: bytes) -> tuple[str, bytes | None]:
    """Return other content of a file, and what happened to it; None for no file."""
    kind = random.choice(("cut", "bit", "bit", "byte", "empty", "garbage", "zeros", "gone", "more"))
    at = random.randrange(len(data)) if data else 0
    if kind == "cut":
        return f"cut at {at}", data[:at]
    if kind == "bit" and data:
        flipped = bytes([data[at] ^ (1 << random.randrange(8))])
        return f"bit at {at}", data[:at] + flipped + data[at + 1 :]
    if kind == "byte" and data:
        return f"byte at {at}", data[:at] + random.randbytes(1) + data[at + 1 :]
    if kind == "zeros":
        return f"zeros from {at}", data[:at] + bytes(len(data) - at)
    if kind == "more":
        return "more", data + random.randbytes(30)
    return kind, {"empty": b"", "garbage": random.randbytes(200), "gone": None}.get(kind, b"")


def commands(run: Path, steps: int) -> dict[str, list[str]]:
    """Return name → the command line of whatever reads a run; results stand beside the run."""
    name, beside = str(run), run.parent
    more = str(steps + 60)
    return {
        "evaluate": ["evaluate", name, "--episodes", "2"],
        "why": ["why", name, "--step", str(steps // 2)],
        "why evaluation": ["why", name, "--step", "0", "--evaluation", "serp-seed5"],
        "report": ["report", name, "--pictures", "0", "--steps", "100",
                   "-o", str(beside / "answer.html")],
        "diagnose": ["diagnose", name, "--json"],
        "repair": ["repair", name, "-o", str(beside / "answer.pddl")],
        "export": ["export", name, "-o", str(beside / "answer")],
        "resume": ["plan-and-learn", "--resume", name, "--env-steps", more, "--quiet"],
    }  # fmt: skip


def answered(run: Path, command: str, steps: int) -> tuple[Ended, Any]:
    """Run a command; return how it ended, and its answer but for times and folders."""
    ended = apart(lambda: serp.main(commands(run, steps)[command], standalone_mode=False))
    if ended.status:
        return ended, None
    if command == "resume":
        return ended, left_by(run)
    files = {
        str(file.relative_to(run.parent)): file.read_bytes().replace(str(run.parent).encode(), b"")
        for place in run.parent.glob("answer*")
        for file in ([place] if place.is_file() else sorted(place.rglob("*")))
        if file.is_file() and file.name != ".lock"
    }
    return ended, (_NUMBERS.sub("", ended.text), files)


def contents(run: Path) -> dict[str, bytes]:
    """Return name → content of the files of a run but for its lock."""
    files = {str(f.relative_to(run)): f for f in run.rglob("*") if f.is_file()}
    return {name: f.read_bytes() for name, f in files.items() if not name.endswith(".lock")}


def torn(number: int) -> Counter[str]:
    """Tear each file of a run, and have it read by every command."""
    if number % 3 == 0:
        return torn_comparison(number)
    random, counts, steps = Random(number), Counter({"torn runs": 1}), 300
    job = Job.drawn(number, steps)
    with scratch() as folder:
        if whole(job, folder) is None:
            return Counter({"runs refused": 1})
        run = folder / "whole"
        first = ["evaluate", str(run), "--seed", "5", "--episodes", "2"]
        clean(apart(lambda: serp.main(first, standalone_mode=False)), "evaluate")
        names = sorted(contents(run))
        own = folder / "own" / "run"
        intact: dict[str, Any] = {}

        def fresh() -> None:
            shutil.rmtree(own.parent, ignore_errors=True)
            shutil.copytree(run, own)

        for command in commands(own, steps):
            fresh()
            ended, intact[command] = answered(own, command, steps)
            clean(ended, f"{command} of an intact run: {job}")
        for name in names:
            data = (run / name).read_bytes()
            how, content = torn_content(random, data)
            for command in commands(own, steps):
                fresh()
                tear(own / name, content)
                before = contents(own)
                ended, answer = answered(own, command, steps)
                what = f"number {number}: {name} ({how}), {command}: {job}"
                clean(ended, what)
                counts["torn files read"] += 1
                after = contents(own)
                lost = [other for other in before if after.get(other) != before[other]]
                if lost and (command != "resume" or ended.status):
                    raise soak.Fault(f"{what}\nchanged {lost}:\n{ended.text[-1000:]}")
                counts["refused"] += ended.status
                if not ended.status and answer != intact[command]:
                    difference(answer, intact[command])
                    raise soak.Fault(f"{what}\nanswers otherwise, without a word")
    return counts


def torn_comparison(number: int) -> Counter[str]:
    """Tear files of a comparison that is complete, and continue it."""
    random, counts = Random(number), Counter({"torn comparisons": 1})
    with scratch() as folder:
        own = folder / "own"
        line = ["compare", "--domain", random.choice(("cliff", "taxi")), "--algorithms", "serp,dqn",
                "--seeds", "2", "--env-steps", "150", "--evaluation-episodes", "1",
                "--final-episodes", "2", "--jobs", "1", "--quiet", "--out", str(own)]  # fmt: skip

        def compared() -> tuple[Ended, Any]:
            ended = apart(lambda: serp.main(line, standalone_mode=False))
            return ended, None if ended.status else results(own)

        ended, intact = compared()
        clean(ended, "compare")
        shutil.copytree(own, folder / "whole")
        names = sorted(contents(own))
        for name in random.sample(names, 8):
            shutil.rmtree(own)
            shutil.copytree(folder / "whole", own)
            how, content = torn_content(random, (own / name).read_bytes())
            tear(own / name, content)
            ended, answer = compared()
            what = f"number {number}: {name} ({how}), compare"
            clean(ended, what)
            counts["torn files read"] += 1
            counts["refused"] += ended.status
            if not ended.status and answer != intact:
                difference(answer, intact)
                raise soak.Fault(f"{what}\nanswers otherwise, without a word")
    return counts


def results(comparison: Path) -> list[dict[str, str]]:
    """Return the measures of a comparison but for times."""
    with open(comparison / "measures.csv", newline="") as file:
        return [{**row, "seconds_per_1000": ""} for row in csv.DictReader(file)]


def tear(file: Path, content: bytes | None) -> None:
    """Give a file other content; None for no file."""
    if content is None:
        file.unlink()
    else:
        file.write_bytes(content)


def difference(answer: Any, expected: Any) -> None:
    """Print where two answers differ."""
    if isinstance(answer, tuple) and isinstance(expected, tuple):
        for one, other in zip(answer, expected, strict=False):
            if one != other:
                difference(one, other)
    elif isinstance(answer, dict) and isinstance(expected, dict):
        for key in answer.keys() | expected.keys():
            if answer.get(key) != expected.get(key):
                print("  ", key, end=" ")
                difference(answer.get(key), expected.get(key))
    else:
        one, other = (x if isinstance(x, str | bytes) else repr(x) for x in (answer, expected))
        at = next((k for k, (a, b) in enumerate(zip(one, other, strict=False)) if a != b), -1)
        print("  ", *(repr(text[max(0, at - 60) : at + 60]) for text in (one, other)), sep=" | ")


KINDS: Final = {"kills": kills, "disk": disk, "torn": torn}
"""Kind → what one number of it does."""
