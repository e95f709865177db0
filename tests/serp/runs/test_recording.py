"""What is recorded of a step is read back, and nothing else is read."""

import io
import itertools
import json
import zipfile

import numpy as np
import pytest

from serp.errors import RunError
from serp.runs.recording import (
    COLUMNS,
    HEADER,
    VETO_COLUMNS,
    Layout,
    Recorder,
    Recording,
    decode,
    encode,
    open_recording,
    vetoed,
)
from serp.runs.trainer import Trainer
from serp.settings import resolve
from tests.serp.sample_tasks import corridor

LAYOUT = Layout(
    fluents=("x",),
    actions=("left", "right", "wait", "dance"),
    ground_actions=("left", "right", "wait"),
    control_period=0.5,
)
COUNT = 23


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr("serp.runs.recording._BLOCK_STEPS", 4)


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    """Steps of episodes that run two at a time, each with its number."""
    task, episodes = corridor(tmp_path_factory.mktemp("recording")), []
    with Trainer(task.bind(), resolve("paper", task.settings), 3) as trainer:
        trainer.on_step = lambda step: episodes[-1].append(step)
        for _ in range(8):
            episodes.append([])
            next(trainer.run())
    pairs = zip(episodes[::2], episodes[1::2], strict=True)
    made = [
        (2 * k + number, step)
        for k, pair in enumerate(pairs)
        for two in itertools.zip_longest(*pair)
        for number, step in enumerate(two, 1)
        if step is not None
    ]
    return made[:COUNT]


def record(folder, steps, at=0):
    with Recorder(folder, LAYOUT, at) as recorder:
        for episode, step in steps[at:]:
            recorder.append(episode, step)
    return folder


def content(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def same(one, other):
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return bool(np.array_equal(one, other, equal_nan=isinstance(one, float)))


def test_a_recorded_step_is_the_step(tmp_path, steps):
    found = Recording(record(tmp_path / "r", steps))
    assert len(found) == COUNT and len(list(tmp_path.glob("r/block-*"))) == 6
    places = {}
    for k, (episode, made) in enumerate(steps):
        places.setdefault(episode, []).append(k)
        read = found.step(k)
        assert same(read.decision, made.decision) and same(read.state, made.state)
        assert (read.episode, read.number) == (episode, made.number)
        assert found.find(episode, made.number - 1) == k
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
def test_a_recording_that_goes_on_from_a_step_is_the_one_that_never_stopped(at, tmp_path, steps):
    whole = content(record(tmp_path / "whole", steps))
    part = record(tmp_path / "part", steps)  # it got further than what was saved
    assert content(record(part, steps, at)) == whole
    with pytest.raises(RunError, match="does not hold the 24 steps"):
        Recorder(part, LAYOUT, COUNT + 1)
    with pytest.raises(RunError, match="does not belong to this run"):
        Recorder(part, LAYOUT.model_copy(update={"fluents": ("z",)}), 1)


def changed(name, change):
    def forge(folder):
        file = folder / "block-000001.npz"
        columns = decode(file, LAYOUT)
        columns[name] = change(columns[name].copy())
        file.write_bytes(encode(columns))

    return forge


def put(value):
    def change(values):
        values[0] = value
        return values

    return change


def huge(folder):
    """A header that promises more than there is, and a member that inflates to much."""
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        array, {"descr": "<i4", "fortran_order": False, "shape": (1 << 40,)}
    )
    with zipfile.ZipFile(folder / "block-000001.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("number.npy", array.getvalue() + bytes(1 << 22))


def last_block(columns):
    return lambda folder: (folder / "block-000006.npz").write_bytes(encode(columns))


def header(**values):
    def forge(folder):
        found = json.loads((folder / HEADER).read_text())
        (folder / HEADER).write_text(json.dumps({**found, **values}))

    return forge


@pytest.mark.parametrize(
    ("forge", "message"),
    [
        (changed("action", put(4)), "action holds 4"),
        (changed("ground", put(3)), "ground holds 3"),
        (changed("reason", put(14)), "reason holds 14"),
        (changed("state", put(np.nan)), "state holds nan"),
        (changed("terminated", lambda v: (v + 2).view(bool)), "terminated"),
        (changed("value", lambda v: v.astype(np.float32)), "value has shape"),
        (changed("number", lambda v: v[:3]), "damaged"),
        (huge, "block-000001.npz is damaged"),
        (lambda folder: (folder / "block-000001.npz").unlink(), "no block 1"),
        (last_block({name: v[:0] for name, v in LAYOUT.empty(1).items()}), "number has shape"),
        (changed("env_reward", put(np.inf)), "env_reward holds inf"),
        (changed("reward", put(-np.inf)), "reward holds -inf"),
        (header(format=1), "another version"),
        (header(actors=["me"]), "another version"),
        (header(fluents=["x", "y"]), "damaged"),
    ],
)
def test_what_was_not_recorded_is_refused(forge, message, tmp_path, steps):
    folder = record(tmp_path / "r", steps)
    forge(folder)
    with pytest.raises(RunError, match=message):
        found = Recording(folder)
        found.columns(*COLUMNS)
        found.step(5)


def test_a_recording_that_is_a_link_is_not_followed(tmp_path, steps):
    run = tmp_path / "run"
    record(tmp_path / "elsewhere", steps)
    (run / "evaluations").mkdir(parents=True)
    for link, evaluation in (("recording", None), ("evaluations/of", "of")):
        (run / link).symlink_to(tmp_path / "elsewhere")
        with pytest.raises(RunError, match=f"{link} is a link"):
            open_recording(run, evaluation)


def test_a_step_that_is_not_there_is_refused_with_those_that_are(tmp_path, steps):
    found = Recording(record(tmp_path / "r", steps))
    with pytest.raises(RunError, match=f"no step {COUNT}: .* steps 0 to {COUNT - 1}"):
        found.step(COUNT)
    with pytest.raises(RunError, match="episode 1 has no step 99: it has .* counted from 0"):
        found.find(1, 99)
