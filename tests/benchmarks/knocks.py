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
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, Final, NamedTuple

from serp.runs.train import plan_and_learn
from serp.tasks.registry import find_task
from serp.tasks.task import Task
from serp.ui.root import exit_with, serp
from tests.benchmarks import soak
from tests.serp.runs.runs import everything

TASKS: Final = ("soccer", "soccer", "cliff", "cartpole", "frozen-lake", "taxi", "corner-kick")
"""Installed tasks of which a run is one; half of the runs are in random worlds."""
ENV_STEPS: Final = 1_500
READERS_A_FILE: Final = 4
"""Commands, drawn by chance, that read a torn file."""
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
        for k in range(1000 * number, 1000 * number + 1000) if random.random() < 0.5 else ():
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


def left_by(run: Path) -> dict[str, Any]:
    """Return what a run left, but for its times."""
    summary = json.loads((run / "summary.json").read_text())
    for name in ("wall_time", "steps_per_second"):
        summary.pop(name, None)
    return dict(zip(PARTS, (*everything(run), summary), strict=True))


def tried(function: Callable[[], Any], what: str, *, must: bool = False) -> Ended:
    """Call a function as `apart` does; check that it ends well or, unless it must, with a message.

    Raises:
        soak.Fault: It does not.
    """
    ended = apart(function)
    errors = sum(line.startswith("Error: ") for line in ended.text.splitlines())
    if "Traceback" in ended.text or ended.status not in (0, 1) or ended.status != errors or (
        must and ended.status
    ):  # fmt: skip
        raise soak.Fault(f"{what}\nended with {ended.status}:\n{ended.text[-3000:]}")
    return ended


def whole(job: Job, folder: Path) -> tuple[dict[str, Any], float, Counter[str]] | None:
    """Make the undisturbed run: what it left, its seconds, counts; None where it is refused."""
    ended = tried(lambda: job.judged(folder / "whole"), f"{job}")
    if ended.status:
        return None
    counts = Counter(json.loads((folder / "counts").read_text()))
    return left_by(folder / "whole"), ended.seconds, counts


def finish(job: Job, run: Path, expected: dict[str, Any], what: str) -> None:
    """Go on with a run, and check that it leaves what is expected.

    Raises:
        soak.Fault: It does not.
    """
    tried(lambda: job.run(run), f"{what}: {job}", must=True)
    left = left_by(run)
    if differing := [part for part in PARTS if left[part] != expected[part]]:
        kept = tempfile.mkdtemp(prefix="differs-")
        shutil.copytree(run, Path(kept) / "run")
        raise soak.Fault(f"{what}: {differing} of the run differ, see {kept}: {job}")


def kills(number: int) -> Counter[str]:
    """Kill a run at random moments, and go on with it."""
    random, job = Random(number), Job.drawn(number, ENV_STEPS)
    with scratch() as folder:
        if (made := whole(job, folder)) is None:
            return Counter({"runs refused": 1})
        expected, seconds, counts = made
        for _ in range(KILLS):
            if apart(lambda: job.run(folder / "run"), random.uniform(0, seconds)).status == 0:
                break
            counts["kills"] += 1
        finish(job, folder / "run", expected, "after kills")
        return counts + Counter({"killed runs": 1})


def disk(number: int) -> Counter[str]:
    """Let a run meet full disks, or a limit of the size of files, and go on with more room.

    A full disk is a small one that is mounted, which takes root.
    """
    random, job = Random(number), Job.drawn(number, ENV_STEPS // 3)
    with scratch() as folder, contextlib.ExitStack() as stack:
        if (made := whole(job, folder)) is None:
            return Counter({"runs refused": 1})
        expected, _, counts = made
        files = [f.stat().st_size for f in (folder / "whole").rglob("*") if f.is_file()]
        mounted = os.geteuid() == 0 and random.random() < 0.7
        most = sum(files) + 4096 * len(files) if mounted else max(files)
        rooms = sorted(random.randint(0, most) // 4096 * 4096 + 4096 for _ in range(4))
        place = folder / "disk"
        place.mkdir()

        def mount(*options: str) -> None:
            subprocess.run(["mount", *options, str(place)], check=True, capture_output=True)

        def limited(room: int) -> None:
            if not mounted:
                hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
                resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
            job.run(place / "run")

        if mounted:
            mount("-t", "tmpfs", "-o", "size=4096", "tmpfs")
            stack.callback(subprocess.run, ["umount", str(place)], check=True)
        what = f"after {'disks' if mounted else 'limits'} of {rooms}"
        for room in rooms:
            if mounted:
                mount("-o", f"remount,size={room}")
            counts["full disks"] += tried(partial(limited, room), f"{what}: {job}").status
        if mounted:
            mount("-o", f"remount,size={1 << 30}")
        finish(job, place / "run", expected, what)
        return counts + Counter({"runs on full disks": 1})


# Torn files ------------------------------------------------------------------------------------


def torn_content(random: Random, data: bytes) -> tuple[str, bytes | None]:
    """Return what happens to a file, and its content then; None for no file."""
    at = random.randrange(len(data) or 1)
    bit = bytes([data[at] ^ (1 << random.randrange(8))]) if data else b"x"
    contents = {
        "cut": data[:at],
        "bit": data[:at] + bit + data[at + 1 :],
        "byte": data[:at] + random.randbytes(1) + data[at + 1 :],
        "zeros": data[:at] + bytes(len(data) - at),
        "more": data + random.randbytes(30),
        "empty": b"",
        "garbage": random.randbytes(200),
        "gone": None,
    }
    kind = random.choice([*contents, "bit", "bit"])
    return f"{kind} at {at}", contents[kind]


Reader = Callable[[Path], Any]
"""Reads a folder by a command; returns its answer but for times and folders."""


def command(*line: str) -> Reader:
    """Return the reader by a command; `{}` is the run, and results stand beside it as `answer…`."""

    def read(run: Path) -> Any:
        serp.main([word.format(run) for word in line], standalone_mode=False)
        sys.stdout.flush()

    return read


READERS: Final[dict[str, Reader]] = {
    "evaluate": command("evaluate", "{}", "--episodes", "2"),
    "why": command("why", "{}", "--step", "150"),
    "why of an evaluation": command("why", "{}", "--step", "0", "--evaluation", "serp-seed5"),
    "report": command(
        "report", "{}", "--pictures", "0", "--steps", "100", "-o", "{}/../answer.html"
    ),
    "diagnose": command("diagnose", "{}", "--json"),
    "repair": command("repair", "{}", "-o", "{}/../answer.pddl"),
    "export": command("export", "{}", "-o", "{}/../answer"),
    "resume": command("plan-and-learn", "--resume", "{}", "--env-steps", "360", "--quiet"),
}
COMPARE: Final = {
    "compare": command(
        "compare", "--domain", "cliff", "--algorithms", "serp,dqn", "--seeds", "2",
        "--env-steps", "150", "--evaluation-episodes", "1", "--final-episodes", "2", "--jobs", "1",
        "--quiet", "--out", "{}"
    )
}  # fmt: skip


def answer_of(run: Path, name: str, ended: Ended) -> Any:
    """Return what a command answered, but for times and folders; None where it refused."""
    if ended.status:
        return None
    if name == "resume":
        return left_by(run)
    if name == "compare":
        with open(run / "measures.csv", newline="") as file:
            return [{**row, "seconds_per_1000": ""} for row in csv.DictReader(file)]
    files = {
        str(file.relative_to(run.parent)): file.read_bytes().replace(str(run.parent).encode(), b"")
        for file in sorted(run.parent.rglob("*"))
        if file.is_file() and run not in file.parents and file.name != ".lock"
    }
    return _NUMBERS.sub("", ended.text), files


def named_otherwise(run: Path, own: Path) -> bool:
    """Return whether two runs differ in the names of their domain files, which are only shown."""
    try:
        made, other = (json.loads((each / "config.json").read_text()) for each in (run, own))
    except (OSError, ValueError):
        return False
    return bool(made.pop("domain_files") != other.pop("domain_files", None) and made == other)


def contents(run: Path) -> dict[str, bytes]:
    """Return name → content of the files of a run but for locks."""
    files = {str(f.relative_to(run)): f for f in run.rglob("*") if f.is_file()}
    return {name: f.read_bytes() for name, f in files.items() if f.name != ".lock"}


def torn(number: int) -> Counter[str]:
    """Tear each file of a run, or some of a comparison, and have it read by commands."""
    random, job = Random(number), Job.drawn(number, 300)
    with scratch() as folder:
        run, own = folder / "whole", folder / "own" / "run"
        readers = READERS if number % 3 else COMPARE
        if readers is COMPARE:
            tried(lambda: COMPARE["compare"](run), "compare", must=True)
        elif whole(job, folder) is None:
            return Counter({"runs refused": 1})
        else:
            evaluate = command("evaluate", "{}", "--seed", "5", "--episodes", "2")
            tried(lambda: evaluate(run), f"evaluate: {job}", must=True)
        names = sorted(contents(run))
        counts = Counter({"torn runs": 1})

        def read(reader: str, what: str, *, must: bool) -> Any:
            before = contents(own)
            ended = tried(lambda: readers[reader](own), what, must=must)
            after = contents(own)
            lost = [name for name in before if after.get(name) != before[name]]
            if reader == "compare":  # the report is made of the trials that are left
                lost = [name for name in lost if ended.status and name.startswith("trials/")]
            if lost and (ended.status or reader != "resume"):
                raise soak.Fault(f"{what}\nchanged {lost}:\n{ended.text[-1000:]}")
            counts["refused"] += ended.status
            return answer_of(own, reader, ended)

        def fresh() -> None:
            shutil.rmtree(own.parent, ignore_errors=True)
            shutil.copytree(run, own)

        intact = {}
        for reader in readers:
            fresh()
            intact[reader] = read(reader, f"{reader} of what is intact: {job}", must=True)
        for name in names if readers is READERS else random.sample(names, 8):
            how, content = torn_content(random, (run / name).read_bytes())
            for reader in random.sample(list(readers), min(READERS_A_FILE, len(readers))):
                fresh()
                if content is None:
                    (own / name).unlink()
                else:
                    (own / name).write_bytes(content)
                what = f"number {number}: {name} ({how}), {reader}: {job}"
                answer = read(reader, what, must=False)
                counts["torn files read"] += 1
                if answer not in (None, intact[reader]) and not named_otherwise(run, own):
                    kept = tempfile.mkdtemp(prefix="answers-")
                    shutil.copytree(own.parent, kept, dirs_exist_ok=True)
                    raise soak.Fault(f"{what}\nanswers otherwise, without a word; see {kept}")
        return counts


KINDS: Final = {"kills": kills, "disk": disk, "torn": torn}
"""Kind → what one number of it does."""
