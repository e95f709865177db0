from __future__ import annotations

import subprocess
import sys

_DRAW_TWICE = """
import sys, matplotlib
import numpy as np
from serp._util.figures import render
from serp.runs.learning_curve import learning_curve
from serp.runs.tables import METRICS_COLUMNS
before = matplotlib.rcParams.copy()  # not dict(): that asks for a backend
metrics = {name: np.ones(3, int) for name in METRICS_COLUMNS}
plain = [render(learning_curve(metrics, "a $b_c$"), kind) for kind in ("png", "svg")]
assert "matplotlib.pyplot" not in sys.modules
assert matplotlib.rcParams.copy() == before
style = {"font.size": 30, "lines.linewidth": 9, "savefig.dpi": 7, "text.usetex": True}
with matplotlib.rc_context(style):
    styled = [render(learning_curve(metrics, "a $b_c$"), kind) for kind in ("png", "svg")]
assert plain == styled
assert b"<dc:date>" not in plain[1]
"""


def test_equal_metrics_give_equal_bytes_whatever_the_users_style_which_is_left_alone():
    subprocess.run([sys.executable, "-c", _DRAW_TWICE], check=True)
