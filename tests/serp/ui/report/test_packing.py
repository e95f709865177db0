"""What is packed for the page is what comes out, to the digits that are shown."""

from __future__ import annotations

import base64
import gzip

import numpy as np

from serp.ui.report.step_data import packed


def test_arrays_come_out_with_four_digits() -> None:
    random = np.random.default_rng(0)
    wide = random.normal(size=1000) * 10.0 ** random.integers(-30, 30, 1000)
    numbers = np.concatenate([wide, [0.0, np.nan, np.inf, -np.inf, 1e300]])
    counts = np.array([0, 1, 255, 65_535, 2**32 - 1], np.uint32)
    text, layout = packed({"numbers": numbers, "counts": counts, "none": np.zeros(0)})
    assert layout == [("numbers", "f4", 1005), ("counts", "u4", 5), ("none", "f4", 0)]
    data = np.frombuffer(gzip.decompress(base64.b64decode(text)), np.uint8)
    first = data[: 4 * 1005].reshape(4, -1).T.copy().view("<f4")[:, 0]
    np.testing.assert_allclose(first[:1004], numbers[:1004], rtol=2e-5)
    assert first[1004] == np.inf  # beyond float32
    assert (data[4 * 1005 :].reshape(4, -1).T.copy().view("<u4")[:, 0] == counts).all()
