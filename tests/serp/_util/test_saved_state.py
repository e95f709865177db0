"""The one place in which what a checkpoint holds is checked."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from serp._util.saved_state import MOST, Saved, state_for
from serp.errors import RunError

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3),
    lambda values: st.lists(values, max_size=3) | st.dictionaries(st.text(max_size=3), values),
    max_leaves=8,
)
KINDS = (np.random.PCG64, np.random.MT19937, np.random.Philox, np.random.SFC64)


@given(
    array=hnp.arrays(
        st.sampled_from([np.dtype(kind) for kind in "fdqb?"]),
        hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
    ),
    low=st.integers(-5, 5),
    high=st.integers(-5, 5),
)
def test_an_array_is_given_out_only_if_all_of_it_is_within(array, low, high):
    """No NaN is within anything, and no array of another kind or shape is given out at all."""
    saved = Saved("part", {"a": array}, {})
    try:
        found = saved.array("a", np.float64, (-1, 2), low, high)
    except RunError:
        fits = array.dtype == np.float64 and array.ndim == 2 and array.shape[1] == 2
        assert not fits or not all(low <= value <= high for value in array.ravel().tolist())
    else:
        assert found is array
        assert array.dtype == np.float64
        assert array.shape[1:] == (2,)
        assert all(low <= value <= high for value in array.ravel().tolist())


@given(value=JSON)
def test_a_json_value_is_given_out_only_if_it_is_what_it_is_taken_for(value):
    for given_out, fits in (
        (lambda s: s.whole("v", 0, 9), type(value) is int and 0 <= value <= 9),
        (lambda s: s.truth("v"), type(value) is bool),
        (lambda s: s.real("v", 0.0, 9.0), type(value) in (int, float) and 0 <= value <= 9),
        (lambda s: s.wholes("v", 2), isinstance(value, list) and len(value) == 2
            and all(type(v) is int and 0 <= v <= MOST for v in value)),
        (lambda s: s.truths("v", 1), isinstance(value, list) and len(value) == 1
            and type(value[0]) is bool),
        (lambda s: s.reals("v", 1), isinstance(value, list) and len(value) == 1
            and all(type(v) in (int, float) and abs(v) <= 1.7976931348623157e308 for v in value)),
    ):  # fmt: skip
        without_v = None if isinstance(value, dict) and "v" in value else value
        for saved in (Saved("part", {}, {"v": value}), Saved("part", {}, without_v)):
            if fits and isinstance(saved._meta, dict) and saved.has("v"):
                assert given_out(saved) == value
            else:
                with pytest.raises(RunError, match="the saved part cannot be restored: v"):
                    given_out(saved)


@pytest.mark.parametrize("kind", KINDS)
def test_the_state_of_a_generator_comes_back_through_json(kind):
    one, other = (np.random.Generator(kind(seed)) for seed in (1, 2))
    one.random(3)
    saved = json.loads(json.dumps(one.bit_generator.state, default=np.ndarray.tolist))
    other.bit_generator.state = state_for(other, saved)
    assert other.random(1000).tobytes() == one.random(1000).tobytes()


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data(), wrong=JSON | st.sampled_from([-1, 2**31, 2**64, 2**128, 5, 625]))
def test_no_forged_state_of_a_generator_reaches_numpy(kind, data, wrong):
    """NumPy reads where `pos` and `buffer_pos` point to, be it beyond its array."""
    generator = np.random.Generator(kind(1))
    saved = json.loads(json.dumps(generator.bit_generator.state, default=np.ndarray.tolist))
    at = saved
    while True:
        keys = sorted(at) if isinstance(at, dict) else range(len(at))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(at[key], dict | list) or data.draw(st.booleans()):
            break
        at = at[key]
    at[key] = wrong
    try:
        generator.bit_generator.state = state_for(generator, saved)
    except ValueError:
        return
    state = json.loads(json.dumps(generator.bit_generator.state, default=np.ndarray.tolist))
    assert state == saved
    assert 0 <= state.get("buffer_pos", 0) <= 4
    assert not isinstance(state["state"], dict) or 0 <= state["state"].get("pos", 0) <= 624
    generator.random(1000)
