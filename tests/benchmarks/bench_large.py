"""How long the studio computes a view of a file with many ground actions.

    python -m tests.benchmarks.bench_large [--trucks N] [--places N] [--packages N]

The domain is one of logistics: a truck drives between any two places, and takes in and puts down
any package at any place. Printed are seconds of this process (the best of three) for a view after
the text has changed, for one after the state has changed, and for the account of a decision.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from serp.agent.explanation import explain
from serp.ui.studio.session import Session, open_session
from serp.ui.studio.view import read

_DOMAIN = """(define (domain logistics)
  (:requirements :strips :typing :numeric-fluents)
  (:types truck place package)
  (:predicates (at ?t - truck ?l - place) (lies ?p - package ?l - place)
    (in ?p - package ?t - truck))
  (:functions (reward))
  (:action drive :parameters (?t - truck ?a - place ?b - place)
    :precondition (and (at ?t ?a) (not (= ?a ?b)))
    :effect (and (not (at ?t ?a)) (at ?t ?b) (decrease (reward) 1.0)))
  (:action load :parameters (?p - package ?t - truck ?l - place)
    :precondition (and (at ?t ?l) (lies ?p ?l))
    :effect (and (not (lies ?p ?l)) (in ?p ?t) (decrease (reward) 0.1)))
  (:action unload :parameters (?p - package ?t - truck ?l - place)
    :precondition (and (at ?t ?l) (in ?p ?t))
    :effect (and (lies ?p ?l) (not (in ?p ?t)) (increase (reward) 2.0))))
"""


def logistics(folder: Path, trucks: int, places: int, packages: int) -> Path:
    """Write a domain and its problem; return the domain."""
    names = {
        kind: [f"{kind[0]}{k}" for k in range(count)]
        for kind, count in (("truck", trucks), ("lot", places), ("package", packages))
    }
    facts = [f"(at {name} l{k % places})" for k, name in enumerate(names["truck"])]
    facts += [f"(lies {name} l{3 * k % places})" for k, name in enumerate(names["package"])]
    (folder / "logistics.pddl").write_text(_DOMAIN)
    (folder / "logistics-problem.pddl").write_text(
        f"""(define (problem many) (:domain logistics)
  (:objects {" ".join(names["truck"])} - truck {" ".join(names["lot"])} - place
    {" ".join(names["package"])} - package)
  (:init {" ".join(facts)} (= (reward) 0.0)))
"""
    )
    return folder / "logistics.pddl"


def seconds(call: Callable[[], object]) -> float:
    taken = []
    for _ in range(3):
        begin = time.process_time()
        call()
        taken.append(time.process_time() - begin)
    return min(taken)


def after_edit(session: Session) -> None:
    session.edit("domain", session.documents["domain"].text + "\n")
    session.request().view()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trucks", type=int, default=5)
    parser.add_argument("--places", type=int, default=12)
    parser.add_argument("--packages", type=int, default=25)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file = logistics(folder, given.trucks, given.places, given.packages)
        session = open_session(str(file), folder)
        session.request().view()  # compiled now
        edited, state = (
            seconds(lambda: after_edit(session)),
            seconds(lambda: session.request().view()),
        )
        _, planner = read(session.version, session.surroundings)
        assert planner is not None
        model = planner.model
        shown = session.shown.state(model)
        plan = planner.plan(shown)
        account = seconds(
            lambda: explain(model, shown, plan.forecast, plan.action, paths=plan.paths)
        )
    print(
        f"{len(model.actions):,} ground actions: a view after an edit {edited:.2f} s, of another "
        f"state {state:.2f} s; an account {account:.3f} s"
    )


if __name__ == "__main__":
    main()
