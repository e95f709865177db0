"""Blocks and gripper of any size, as texts that every planner for PDDL reads."""

from random import Random

from tests.generated.writer import Texts
from tests.worlds import text

BLOCKS = text("blocks")
GRIPPER = text("gripper")


def blocks(count, seed=0):
    """Blocks that stand in random towers, and other towers that are to be built of them."""
    random, names = Random(seed), [f"b{k}" for k in range(count)]
    init, goal = (" ".join(_towers(random, names)) for _ in range(2))
    return Texts(BLOCKS, _problem("blocks", " ".join(names), f"(empty) {init}", goal))


def _towers(random, names):
    order, facts = random.sample(names, len(names)), []
    for k, name in enumerate(order):
        on_table = k == 0 or random.random() < 0.3
        facts.append(f"(table {name})" if on_table else f"(on {name} {order[k - 1]})")
        if on_table and k:
            facts.append(f"(clear {order[k - 1]})")
    return [*facts, f"(clear {order[-1]})"]


def gripper(balls):
    """Two rooms, two grippers, and balls to be brought from one to the other."""
    names = [f"ball{k}" for k in range(balls)]
    init = "(room a) (room b) (gripper left) (gripper right) (robby a) (free left) (free right) "
    init += " ".join(f"(ball {b}) (at {b} a)" for b in names)
    goal = " ".join(f"(at {b} b)" for b in names)
    return Texts(GRIPPER, _problem("gripper", " ".join(["a b left right", *names]), init, goal))


def _problem(name, objects, init, goal):
    return (
        f"(define (problem {name}-1) (:domain {name}) (:objects {objects})\n"
        f"  (:init {init})\n  (:goal (and {goal})))"
    )
