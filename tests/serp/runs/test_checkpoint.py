"""A checkpoint comes back exactly, or is refused. `tests.test_soak` kills what writes one."""

import json

import numpy as np
import pytest
import safetensors.numpy
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from serp.errors import RunError
from serp.runs import checkpoint
from serp.runs.checkpoint import FORMAT, load, save

DTYPES = [bool, np.int8, np.uint8, np.int32, np.int64, np.uint64, np.float32, np.float64]
ARRAYS = {"weights": np.arange(6, dtype=np.float32).reshape(2, 3), "filled": np.array(3)}
META = {"episode": 7, "rho": 0.1, "name": "größer", "list": [1, None, True]}
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**200), 2**200) | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(
    arrays=st.dictionaries(
        st.text(min_size=1, max_size=8).filter(lambda name: name != "__metadata__"),
        hnp.arrays(st.sampled_from(DTYPES), hnp.array_shapes(min_dims=0, max_dims=3, min_side=0)),
        max_size=4,
    ),
    meta=st.dictionaries(st.text(), JSON, max_size=4),
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
    assert json.dumps(loaded_meta) == json.dumps(meta)  # 1, 1.0 and True are equal to Python


def test_every_cut_and_every_flipped_bit_is_noticed_or_without_effect(tmp_path):
    path = tmp_path / "c"
    save(path, ARRAYS, META)
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(RunError, match="is damaged"):
            load(path)
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
        assert meta == META
        assert all((arrays[name] == array).all() for name, array in ARRAYS.items())
    assert unnoticed < 3


@pytest.mark.parametrize("text", ["[1]", "[" * 10**5])
def test_forged_metadata_with_a_digest_that_fits_is_damage(tmp_path, text):
    entry = {"format": FORMAT, "sha256": checkpoint._digest({}, text), "meta": text}
    data = safetensors.numpy.save({}, {"serp": json.dumps(entry)})
    (tmp_path / "c").write_bytes(data)
    with pytest.raises(RunError, match="its metadata cannot be read"):
        load(tmp_path / "c")


@pytest.mark.parametrize("version", [1, FORMAT + 1])
def test_other_formats_are_refused_with_the_reason(tmp_path, monkeypatch, version):
    with monkeypatch.context() as other:
        other.setattr(checkpoint, "FORMAT", version)
        save(tmp_path / "c", ARRAYS, META)
    with pytest.raises(RunError, match=f"has format {version}, which another version"):
        load(tmp_path / "c")


def test_what_is_no_checkpoint_is_a_run_error(tmp_path):
    with pytest.raises(RunError, match=r"there is no checkpoint.*once it has written its first"):
        load(tmp_path / "c")
    safetensors.numpy.save_file(ARRAYS, tmp_path / "c")
    with pytest.raises(RunError, match="not a checkpoint of serp"):
        load(tmp_path / "c")
