"""What a graph of cells costs: expansion and solution of about 100,000 edges, and a look-up.

    python tests/benchmarks/bench_cells.py [--edges N]

A drifting point in the plane with five actions; the states are visited at random. The fastest of
three rounds is printed. Nothing is asserted.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

import serp
from serp.planning.cell_graph import CellGraph
from serp.planning.cells import value_at
from serp.settings import PlannerSettings

DRIFT = """
(define (domain drift)
  (:predicates (terminal))
  (:functions (x) (y) (reward))
  (:action up :parameters () :precondition (and) :effect (increase (y) 0.0103))
  (:action down :parameters () :precondition (and) :effect (decrease (y) 0.0107))
  (:action left :parameters () :precondition (and) :effect (decrease (x) 0.0109))
  (:action right :parameters () :precondition (and) :effect (increase (x) 0.0113))
  (:action wait :parameters () :precondition (and) :effect (increase (x) (* 0.01 (y))))
  (:event time :parameters () :precondition (and) :effect (decrease (reward) 1))
  (:event end :parameters () :precondition (and (>= (x) 0.99)) :effect (terminal)))
"""


def main() -> None:
    """Print the times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--edges", type=int, default=200_000)
    edges = parser.parse_args().edges
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "drift.pddl"
        path.write_text(DRIFT, encoding="utf-8")
        model = serp.load_domain(path).model
    states = np.random.default_rng(0).random((5_000, 2))
    graph = CellGraph(model, PlannerSettings(), max_edges=edges)
    graph.build(states[0], states, 10 * edges)
    times = []
    for _ in range(3):
        begin = perf_counter()
        graph.build(states[0], states, 10 * edges)
        times.append(perf_counter() - begin)
    print(f"{graph.nodes:,} cells, {graph.edges:,} edges: {min(times):.3f} s")
    flat = states.ravel()
    begin = perf_counter()
    for k in range(len(states)):
        value_at(graph.values, flat, 2 * k)
    print(f"look-up, called from Python: {(perf_counter() - begin) / len(states) * 1e6:.2f} µs")


if __name__ == "__main__":
    main()
