"""How fast the planner is: beside C, and on a closed graph.

    python -m tests.benchmarks.bench_planning [--rounds 9] [--only lookahead,closed]

`lookahead`: a lookahead of depth 5 in the file of cart-pole with 3 and 5 actions, and the same
search written by hand in C (`cc -O2`); both have to return the same values. `closed`: expanding
and solving the graph of a taxi in a larger town. What is compared takes turns in one process. Times
are medians of processor time.
"""

from __future__ import annotations

import argparse
import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from serp.model.domain import load_domain
from serp.model.transition_model import TransitionModel
from serp.planning.closed_graph import ClosedGraph
from serp.planning.lookahead import Lookahead
from serp.settings import PlannerSettings

DOMAINS = Path(__file__).parents[2] / "domains"
PUSHES = {"rest": 0.0, "half-left": -0.5, "half-right": 0.5}
"""Actions that cart-pole has beside its two, and their strength."""
SEARCH = Path(__file__).with_name("cartpole_lookahead.c")
TOWN = 75
"""Rows and columns of the taxi's town: about 90,000 edges."""


def medians(rounds: int, *works: Callable[[], Any]) -> list[float]:
    """Call functions in turn; return the median seconds of each."""
    times = np.zeros((rounds, len(works)))
    for _ in range(2):  # what is compiled, read or allocated at first
        for work in works:
            work()
    for row in times:
        for k, work in enumerate(works):
            start = time.process_time()
            work()
            row[k] = time.process_time() - start
    return np.median(times, axis=0).tolist()  # type: ignore[no-any-return]


# Beside C --------------------------------------------------------------------------------------


def cartpole(actions: int, folder: Path) -> TransitionModel:
    """Return the model of cart-pole with further pushes."""
    further = "".join(
        f"(:action {name} :parameters () :precondition (and) :effect (and "
        f"(increase (cart-velocity) {0.195 * force}) (decrease (pole-velocity) {0.29 * force})))\n"
        for name, force in [*PUSHES.items()][: actions - 2]
    )
    text = (DOMAINS / "cartpole.pddl").read_text(encoding="utf-8")
    file = folder / f"cartpole-{actions}.pddl"
    file.write_text(text.replace("(:process roll", further + "(:process roll"), encoding="utf-8")
    return load_domain(file, observed=True).model.replace(dt=0.02)


def beside_c(rounds: int, folder: Path) -> None:
    """Compare with the search in C."""
    states = np.random.default_rng(0).uniform(-1, 1, (200, 4)) * (2.4, 1.5, 0.25, 1.5)
    flags = ["-O2", "-std=c11", "-ffp-contract=off", "-shared", "-fPIC"]
    for actions in (3, 5):
        library = folder / f"search{actions}.so"
        define = f"-DACTIONS={actions}"
        subprocess.run(["cc", *flags, define, "-o", library, SEARCH, "-lm"], check=True)
        search = ctypes.CDLL(str(library)).lookahead
        values, edges = np.zeros((len(states), actions)), ctypes.c_long()
        arrays = [ctypes.c_void_p(array.ctypes.data) for array in (states, values)]
        lookahead = Lookahead(cartpole(actions, folder), PlannerSettings())

        def in_c(search: Any = search, arrays: Any = arrays, edges: Any = edges) -> None:
            search(ctypes.c_int(len(states)), *arrays, ctypes.byref(edges))

        def in_serp(lookahead: Lookahead = lookahead) -> list[Any]:
            return [lookahead.forecast(state).value for state in states]

        in_c()
        np.testing.assert_allclose(in_serp(), values, rtol=1e-12, atol=1e-12)
        c, serp = (seconds / len(states) for seconds in medians(rounds, in_c, in_serp))
        each = edges.value / len(states)
        print(
            f"lookahead, {actions} actions: {each:.0f} edges, C {1e6 * c:.1f} µs "
            f"({1e9 * c / each:.1f} ns an edge), serp {1e6 * serp:.1f} µs, ratio {serp / c:.2f}"
        )


# Closed graph ----------------------------------------------------------------------------------


def closed(rounds: int, folder: Path) -> None:
    """Expand and solve the graph of a large taxi task."""
    text = (DOMAINS / "taxi.pddl").read_text(encoding="utf-8")
    for name in ("row", "column"):
        text = text.replace(f"(< ({name}) 4)", f"(< ({name}) {TOWN - 1})")
    for file, content in (
        ("taxi", text),
        ("taxi-problem", (DOMAINS / "taxi-problem.pddl").read_text(encoding="utf-8")),
    ):
        (folder / f"{file}.pddl").write_text(content, encoding="utf-8")
    model = load_domain(folder / "taxi.pddl").model
    edges = [0]

    def grow() -> None:
        graph = ClosedGraph(model, PlannerSettings())
        graph.grow(model.initial_state)
        assert graph.complete and graph.ends(model.initial_state)
        edges[0] = graph.edges

    (seconds,) = medians(rounds, grow)
    print(
        f"closed graph: {edges[0]} edges expanded and solved in {1e3 * seconds:.0f} ms, "
        f"{edges[0] / seconds:,.0f} edges/s"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--only", default="lookahead,closed")
    options = parser.parse_args()
    wanted = options.only.split(",")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "lookahead" in wanted:
            beside_c(options.rounds, folder)
        if "closed" in wanted:
            closed(options.rounds, folder)


if __name__ == "__main__":
    main()
