from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from serp.errors import RunError
from serp.runs import checkpoint
from serp.runs.checkpoint import (
    FORMAT,
    NEWEST,
    PREVIOUS,
    CheckpointDamaged,
    load,
    load_newest,
    save,
    save_rotating,
)

DTYPES = [bool, np.int8, np.uint8, np.int32, np.int64, np.uint64, np.float32, np.float64]
ARRAYS = {"weights": np.arange(6, dtype=np.float32).reshape(2, 3), "filled": np.array(3)}
META = {"episode": 7, "rho": 0.1, "name": "größer", "list": [1, None, True]}


def json_values():
    plain = (
        st.none()
        | st.booleans()
        | st.integers(min_value=-(2**200), max_value=2**200)
        | st.floats(allow_nan=False)
        | st.text()
    )
    return st.recursive(
        plain,
        lambda inner: (
            st.lists(inner) | st.dictionaries(st.text() | st.just("float"), inner, max_size=3)
        ),
        max_leaves=8,
    )


@given(
    arrays=st.dictionaries(
        st.text(min_size=1, max_size=8).filter(lambda name: name != "__metadata__"),
        hnp.arrays(st.sampled_from(DTYPES), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0)),
        max_size=4,
    ),
    meta=st.dictionaries(st.text(), json_values(), max_size=4),
)
@settings(max_examples=50, deadline=None)
def test_everything_comes_back_exactly(tmp_path_factory, arrays, meta):
    path = tmp_path_factory.getbasetemp() / "round-trip.safetensors"
    save(path, arrays, meta)
    loaded, loaded_meta = load(path)
    assert loaded.keys() == arrays.keys()
    for name, array in arrays.items():
        assert loaded[name].dtype == array.dtype
        assert loaded[name].shape == array.shape
        assert loaded[name].tobytes() == array.tobytes()  # NaN payloads and -0.0 too
        assert loaded[name].flags.writeable
    assert loaded_meta == meta
    assert json.dumps(loaded_meta) == json.dumps(meta)  # 1, 1.0 and True are equal to Python


def test_the_header_is_json_for_strict_readers_whatever_the_numbers(tmp_path):
    def refuse(word):
        raise AssertionError(word)

    meta = {
        "seen": [math.inf, -math.inf, {"deep": math.nan}], "own": {"float": [math.inf, "inf"]},
        "scalars": [np.int64(3), np.float64(0.1)],
    }  # fmt: skip
    save(tmp_path / "c", {}, meta)
    data = (tmp_path / "c").read_bytes()
    size = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + size], parse_constant=refuse)
    json.loads(header["__metadata__"]["serp"], parse_constant=refuse)
    loaded = load(tmp_path / "c")[1]
    assert (loaded["own"], loaded["scalars"]) == (meta["own"], [3, 0.1])
    assert loaded["seen"][:2] == meta["seen"][:2]
    assert math.isnan(loaded["seen"][2]["deep"])


@pytest.mark.parametrize(
    "view",
    [
        lambda a: a.T,
        lambda a: a[::2, 1:],
        lambda a: a[::-1],
        lambda a: a.astype(">f8"),
        lambda a: np.asfortranarray(a),
        lambda a: np.broadcast_to(a[0], (4, 3)),
    ],
)
def test_views_are_saved_as_what_they_show(tmp_path, view):
    array = view(np.arange(12.0).reshape(4, 3))
    save(tmp_path / "c", {"x": array}, {})
    assert (load(tmp_path / "c")[0]["x"] == array).all()


def test_equal_states_give_equal_bytes_in_the_open_format(tmp_path):
    save(tmp_path / "a", ARRAYS, META)
    save(tmp_path / "b", dict(reversed(ARRAYS.items())), META)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    plain = safetensors.numpy.load_file(tmp_path / "a")
    assert (plain["weights"] == ARRAYS["weights"]).all()


@pytest.mark.parametrize(
    ("array", "meta", "said"),
    [
        (np.array(["text"]), {}, "'x' has dtype"),
        (np.array([None]), {}, "'x' has dtype"),
        (np.zeros(2, complex), {}, "'x' has dtype"),
        (np.zeros(2), {"x": {1, 2}}, "cannot hold a set"),
    ],
)
def test_what_the_format_cannot_hold_is_refused(tmp_path, array, meta, said):
    with pytest.raises(TypeError, match=said):
        save(tmp_path / "c", {"x": array}, meta)
    assert not os.listdir(tmp_path)


def test_every_cut_is_noticed(tmp_path):
    path = tmp_path / "c"
    save(path, ARRAYS, META)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(CheckpointDamaged, match="is damaged"):
            load(path)


def test_a_flipped_bit_anywhere_is_noticed_or_without_effect(tmp_path):
    path = tmp_path / "c"
    save(path, ARRAYS, META)
    whole = path.read_bytes()
    data_begins = 8 + int.from_bytes(whole[:8], "little")
    unnoticed = 0
    rng = np.random.default_rng(0)
    for bit in 8 * np.arange(len(whole)) + rng.integers(8, size=len(whole)):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << int(bit % 8)
        path.write_bytes(changed)
        try:
            arrays, meta = load(path)
        except RunError:
            continue
        # A letter of an escape may change its case: the same JSON in other words.
        unnoticed += 1
        assert bit // 8 < data_begins
        assert meta == META
        assert all((arrays[name] == array).all() for name, array in ARRAYS.items())
    assert unnoticed < 3


@pytest.mark.parametrize(
    ("version", "said"),
    [
        (
            FORMAT + 1,
            f"format {FORMAT + 1}; this serp knows .* {FORMAT}. Install a newer",
        ),
        (1, "has format 1, which an earlier serp wrote"),
    ],
)
def test_other_formats_are_refused_with_the_reason(tmp_path, monkeypatch, version, said):
    with monkeypatch.context() as other:
        other.setattr(checkpoint, "FORMAT", version)
        save(tmp_path / NEWEST, ARRAYS, META)
    save(tmp_path / PREVIOUS, ARRAYS, META)  # it is not damaged: there is no way round it
    with pytest.raises(RunError, match=said):
        load_newest(tmp_path)


def test_other_safetensors_files_are_no_checkpoints(tmp_path):
    safetensors.numpy.save_file(ARRAYS, tmp_path / "c")
    with pytest.raises(RunError, match="not a checkpoint of serp"):
        load(tmp_path / "c")


def test_missing_and_unreadable_files_are_run_errors(tmp_path):
    with pytest.raises(RunError, match="there is no checkpoint"):
        load_newest(tmp_path)
    (tmp_path / NEWEST).mkdir()
    with pytest.raises(RunError, match="is a link, a folder"):
        load_newest(tmp_path)


def test_rotation_keeps_the_one_before(tmp_path):
    for episode in range(4):
        save_rotating(tmp_path, ARRAYS, {"episode": episode})
    assert load(tmp_path / NEWEST)[1] == {"episode": 3}
    assert load(tmp_path / PREVIOUS)[1] == {"episode": 2}
    assert sorted(os.listdir(tmp_path)) == [PREVIOUS, NEWEST]
    found = load_newest(tmp_path)
    assert (found.meta, found.path, found.fallback) == ({"episode": 3}, tmp_path / NEWEST, None)


def test_rotation_works_without_hard_links(tmp_path, monkeypatch):
    def no_links(*_):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(os, "link", no_links)
    test_rotation_keeps_the_one_before(tmp_path)


def test_rotation_after_a_crash_between_its_two_renames(tmp_path):
    save_rotating(tmp_path, ARRAYS, {"episode": 0})
    os.link(tmp_path / NEWEST, tmp_path / PREVIOUS)
    save_rotating(tmp_path, ARRAYS, {"episode": 1})
    assert sorted(os.listdir(tmp_path)) == [PREVIOUS, NEWEST]
    assert load(tmp_path / PREVIOUS)[1] == {"episode": 0}


@pytest.mark.parametrize("damage", ["cut", "flipped", "gone"])
def test_damaged_newest_falls_back_to_the_previous_and_says_so(tmp_path, damage):
    save_rotating(tmp_path, ARRAYS, {"episode": 0})
    save_rotating(tmp_path, ARRAYS, {"episode": 1})
    newest = tmp_path / NEWEST
    content = bytearray(newest.read_bytes())
    if damage == "cut":
        newest.write_bytes(content[: len(content) // 2])
    elif damage == "flipped":
        content[-1] ^= 1
        newest.write_bytes(content)
    else:
        newest.unlink()
    found = load_newest(tmp_path)
    assert found.meta == {"episode": 0}
    assert found.path == tmp_path / PREVIOUS
    assert str(newest) in found.fallback


_SAVE_FOR_EVER = """
import sys
import numpy as np
from serp.runs.checkpoint import save_rotating
for episode in range(10**9):
    save_rotating(sys.argv[1], {"x": np.full(20_000, float(episode))}, {"episode": episode})
    if episode == 1:
        print(flush=True)
"""


def test_killed_at_any_moment_a_whole_checkpoint_is_there(tmp_path):
    rng = np.random.default_rng(1)
    for _ in range(4):
        child = subprocess.Popen(
            [sys.executable, "-c", _SAVE_FOR_EVER, str(tmp_path)], stdout=subprocess.PIPE
        )
        with child:
            child.stdout.readline()
            time.sleep(rng.uniform(0, 0.05))
            child.send_signal(signal.SIGKILL)
        found = load_newest(tmp_path)
        assert found.fallback is None
        assert (found.arrays["x"] == found.meta["episode"]).all()
        assert load(tmp_path / PREVIOUS)[1]["episode"] <= found.meta["episode"]


def test_metadata_of_no_known_form_is_damage(tmp_path):
    """Whoever forges it can make its digest fit."""
    deep = "[" * 900 + "]" * 900
    for text in ('{"a": {"float": "1"}}', '{"a": {"float": {}}}', '{"a": {"float": []}}',
                 '{"a": {"float": null}}', '[1]', '"text"', f'{{"a": {deep}}}'):  # fmt: skip
        meta = json.loads(text)
        entry = {"format": FORMAT, "sha256": checkpoint._digest({}, meta), "meta": meta}
        data = safetensors.numpy.save({}, {"serp": json.dumps(entry)})
        (tmp_path / NEWEST).write_bytes(data)
        try:
            arrays, found = load(tmp_path / NEWEST)
        except CheckpointDamaged as error:
            assert "its metadata cannot be read" in str(error)
        else:
            assert (arrays, found) == ({}, meta)
