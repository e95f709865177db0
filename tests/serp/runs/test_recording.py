"""What is recorded of a step is read back, and nothing else is read."""

import io
import json
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from serp.agent.decision import Actor, Decision, Reason
from serp.agent.step_record import StepRecord
from serp.errors import RunError
from serp.planning.edges import Bound
from serp.planning.forecast import SAFE
from serp.runs.recording import (
    COLUMNS,
    HEADER,
    VETO_COLUMNS,
    Columns,
    Layout,
    Recorder,
    Recording,
    decode,
    encode,
    vetoed,
)
from serp.tasks.action_map import ActionForecast
from tests.serp.agent.records import step_record

LAYOUT = Layout(
    fluents=("x", "y"),
    actions=("left", "right", "wave"),
    ground_actions=("left", "right"),
    control_period=0.5,
)
COUNT = 23


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serp.runs.recording._BLOCK_STEPS", 4)


def made_up() -> list[tuple[int, StepRecord]]:
    """Steps of episodes that run two at a time, each with its number."""
    random = np.random.default_rng(5)
    running = [(k, 1, random.normal(size=2)) for k in (1, 2)]
    steps = []
    for k in range(COUNT):
        episode, number, state = running.pop(0)
        forecast = ActionForecast(
            choice=int(random.integers(-1, 3)),
            ground=random.integers(-1, 2, 3),
            value=np.append(random.normal(size=2), -np.inf),
            path_risk=random.random(3),
            safe_steps=np.array([SAFE, -1, 3]),
            reward=random.normal(size=3),
            flags=np.array([1, 2, 1 | 77 << 8]),
            depth=int(random.integers(9)),
            bound=list(Bound)[k % len(Bound)],
            indifferent=k % 3 == 0,
        )
        decision = Decision(
            action=int(random.integers(3)),
            executed_by=list(Actor)[k % len(Actor)],
            reason=list(Reason)[k % len(Reason)],
            proposed=int(random.integers(-1, 3)),
            proposed_by=list(Actor)[k % 3],
            rho=float("nan") if k == 3 else float(random.random()),
            forecast=forecast,
            admissible=random.random(3) < 0.5,
        )
        following, last = random.normal(size=2), bool(random.random() < 0.3)
        made = step_record(
            decision,
            number=number,
            state=state,
            next_state=following,
            reward=float(random.normal()),
            unsafe_observed=k % 5 == 0,
            terminated=last and k % 2 == 0,
            truncated=last and k % 2 == 1,
        )
        steps.append((episode, made))
        begun = max(episode, *(other for other, *_ in running)) + 1
        running.append((begun, 1, state) if last else (episode, number + 1, following))
    return steps


def record(folder: Path, steps: Sequence[tuple[int, StepRecord]], at: int = 0) -> Path:
    with Recorder(folder, LAYOUT, at) as recorder:
        for episode, step in steps[at:]:
            recorder.append(episode, step)
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def same(one: Any, other: Any) -> bool:
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(np.array_equal(one, other, equal_nan=isinstance(one, float)))


def test_a_recorded_step_is_the_step(tmp_path: Path) -> None:
    steps = made_up()
    found = Recording(record(tmp_path / "r", steps))
    assert len(found) == COUNT and len(list(tmp_path.glob("r/block-*"))) == 6
    places: dict[int, list[int]] = {}
    for k, (episode, made) in enumerate(steps):
        places.setdefault(episode, []).append(k)
        read = found.step(k)
        assert same(read.decision, made.decision) and same(read.state, made.state)
        assert (read.episode, read.number) == (episode, made.number)
        assert found.find(episode, made.number) == k
        assert same(read.next_state, made.next_state)
        for name in ("env_reward", "domain_reward", "terminated", "truncated"):
            assert getattr(read, name) == getattr(made, name)
        assert read.unsafe == made.unsafe_observed
    assert {e: s.tolist() for e, s in found.episodes.items()} == places
    states = np.array([made.state for _, made in steps])
    assert same(found.ranges, (states.min(axis=0), states.max(axis=0)))
    assert same(found.columns("action")["action"], [made.decision.action for _, made in steps])
    vetoes = [made.decision.vetoed for _, made in steps]
    assert vetoed(found.columns(*VETO_COLUMNS)).tolist() == vetoes
    changes = [made.next_state - made.state for _, made in steps if not made.last]
    assert np.allclose(found.usual_change, np.sqrt(np.mean(np.square(changes), axis=0)))


@pytest.mark.parametrize("at", [0, 1, 4, 7, 8, COUNT])
def test_a_recording_that_goes_on_from_a_step_is_the_one_that_never_stopped(
    at: int, tmp_path: Path
) -> None:
    steps = made_up()
    whole = content(record(tmp_path / "whole", steps))
    part = record(tmp_path / "part", made_up())  # it got further than what was saved
    assert content(record(part, steps, at)) == whole
    with pytest.raises(RunError, match="does not hold the 24 steps"):
        Recorder(part, LAYOUT, COUNT + 1)
    with pytest.raises(RunError, match="not of this run"):
        Recorder(part, LAYOUT.model_copy(update={"fluents": ("x", "z")}), 1)


def changed(name: str, change: Callable[[Any], Any]) -> Callable[[Path], None]:
    def forge(folder: Path) -> None:
        file = folder / "block-000001.npz"
        columns = decode(file, LAYOUT)
        columns[name] = change(columns[name].copy())
        file.write_bytes(encode(columns))

    return forge


def put(value: Any) -> Callable[[Any], Any]:
    def change(values: Any) -> Any:
        values[0] = value
        return values

    return change


def without(folder: Path) -> None:
    columns = decode(folder / "block-000001.npz", LAYOUT, COLUMNS[:5])
    (folder / "block-000001.npz").write_bytes(encode(columns))


def cut(folder: Path) -> None:
    file = folder / "block-000001.npz"
    file.write_bytes(file.read_bytes()[:-40])


def huge(folder: Path) -> None:
    """A header that promises more than there is, and a member that inflates to much."""
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        array, {"descr": "<i4", "fortran_order": False, "shape": (1 << 40,)}
    )
    with zipfile.ZipFile(folder / "block-000001.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("number.npy", array.getvalue() + bytes(1 << 22))


def last_block(columns: Columns) -> Callable[[Path], object]:
    return lambda folder: (folder / "block-000006.npz").write_bytes(encode(columns))


def no_header(folder: Path) -> None:
    with zipfile.ZipFile(folder / "block-000001.npz", "w") as archive:
        archive.writestr("number.npy", b"\x93NUMPY\1\0\6\0{[]:1}")


def header(**values: Any) -> Callable[[Path], None]:
    def forge(folder: Path) -> None:
        found = json.loads((folder / HEADER).read_text())
        (folder / HEADER).write_text(json.dumps({**found, **values}))

    return forge


@pytest.mark.parametrize(
    ("forge", "message"),
    [
        (changed("action", put(3)), "action holds 3"),
        (changed("ground", put(2)), "ground holds 2"),
        (changed("reason", put(13)), "reason holds 13"),
        (changed("state", put(np.nan)), "state holds nan"),
        (changed("terminated", lambda v: (v + 2).view(bool)), "terminated"),
        (changed("value", lambda v: v.astype(np.float32)), "value has shape"),
        (changed("number", lambda v: v[:3]), "damaged"),
        (without, "block-000001.npz is damaged"),
        (cut, "block-000001.npz is damaged"),
        (huge, "block-000001.npz is damaged"),
        (lambda folder: (folder / "block-000001.npz").unlink(), "no block 1"),
        (last_block({name: v[:0] for name, v in LAYOUT.empty(1).items()}), "number has shape"),
        (no_header, "block-000001.npz is damaged"),
        (changed("env_reward", put(np.inf)), "env_reward holds inf"),
        (changed("reward", put(-np.inf)), "reward holds -inf"),
        (header(format=1), "another version"),
        (header(actors=["me"]), "another version"),
        (header(fluents=["x"]), "damaged"),
    ],
)
def test_what_was_not_recorded_is_refused(
    forge: Callable[[Path], object], message: str, tmp_path: Path
) -> None:
    folder = record(tmp_path / "r", made_up())
    forge(folder)
    with pytest.raises(RunError, match=message):
        found = Recording(folder)
        found.columns(*COLUMNS)
        found.step(5)


def test_a_step_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    found = Recording(record(tmp_path / "r", made_up()))
    for call, message in (
        (lambda: found.step(COUNT), f"no step {COUNT}: .* steps 0 to {COUNT - 1}"),
        (lambda: found.find(99, 1), "no episode 99: .* episodes 1 to"),
        (lambda: found.find(1, 99), "episode 1 has no step 99: it has .* counted from 1"),
        (lambda: Recording(tmp_path), "cannot read"),
        (lambda: Recording(record(tmp_path / "empty", [])).step(0), "no steps yet"),
    ):
        with pytest.raises(RunError, match=message):
            call()
