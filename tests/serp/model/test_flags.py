"""Flags carry a risk beside their bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from serp.model.flags import RISK_SHIFT, RISK_UNIT, UNSAFE, joined, risk_of
from tests.generated.profile import examples


@examples(100)
@given(st.integers(0, 31), st.integers(0, 31), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_flags_carry_a_risk_beside_their_bits(bits, others, risk, other):
    flags, further = (
        of | int(chance / RISK_UNIT + 0.5) << RISK_SHIFT
        for of, chance in ((bits, risk), (others, other))
    )
    both = joined(flags, further)
    assert both & 0xFF == bits | others
    if not bits & UNSAFE:
        assert risk_of(flags) == pytest.approx(risk, abs=2.0**-25)
    if not (bits | others) & UNSAFE:
        assert risk_of(both) == pytest.approx(1 - (1 - risk) * (1 - other), abs=2.0**-22)
    else:
        assert risk_of(both) == 1.0
