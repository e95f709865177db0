"""Forged checkpoints: what a run resumes from, changed somewhere, with a digest that is right.

Run as a program (`python -m tests.forging FOLDER FIRST COUNT`) it forges checkpoints of one run and
resumes each; with `robots` as a fourth argument it forges the folder that the run is exported to,
and decides. It says on every line what it is about to do, so that a process that dies, hangs or
raises anything but a `SerpError` is known by its seed.
"""

import copy
import faulthandler
import json
import random
import shutil
import sys
from pathlib import Path

import numpy as np

from serp import plan_and_learn
from serp.errors import SerpError
from serp.runs import results
from serp.runs.checkpoint import CHECKPOINT, load, save
from serp.runs.folder import METRICS
from serp.runs.policy import Policy, export_policy
from serp.runs.tables import read_metrics

BEGUN, FURTHER = 600, 40
"""Env steps of the run, and after it was resumed."""
SECONDS = 60
"""Nothing takes so long but what hangs."""
SETTINGS = {"learner": {"hidden": [16], "members": 2, "n_step": 3}}
NUMBERS = (0, 1, -1, 2, 3.5, 2**31, 2**45, -(2**45), 2**62, 1e60, 1e308, -1e308, 1e-300,
           float("nan"), float("inf"), float("-inf"))  # fmt: skip
VALUES = (*NUMBERS, 2**70, -(2**200), True, False, None, "", "planner", [], [1], [[0, -1, 0]] * 9,
          {}, {"state": 1})  # fmt: skip


def begin(name, path):
    """Trains for a while."""
    plan_and_learn(name, settings=SETTINGS, env_steps=BEGUN, out=path, seed=1, quiet=True)


def resumed(path):
    """Goes on with a run; says how that ended. Anything but a `SerpError` is raised."""
    try:
        plan_and_learn("", out=path, env_steps=BEGUN + FURTHER, resume=True, quiet=True)
    except SerpError as error:
        return f"refused: {error}"
    metrics = read_metrics(path / METRICS)
    for column in ("length", "return", "planner_steps", "learner_steps"):
        assert np.isfinite(metrics[column]).all(), column
    return "went on"


def decided(path):
    """Makes some decisions on a robot; says how that ended."""
    try:
        policy = Policy(path)
        for k in range(12):
            state = np.full(len(policy.fluents), float(k % 4))
            policy.decide(np.full(len(policy.about["observation"]), float(k)), state=state)
    except SerpError as error:
        return f"refused: {error}"
    return "went on"


def forged(arrays, meta, dice):
    """Changes one thing in a checkpoint, where it is; says what."""
    leaves = list(_leaves(meta))
    if dice.random() < len(arrays) / (len(arrays) + len(leaves)):
        name = dice.choice(sorted(arrays))
        what, change = dice.choice(_OF_ARRAYS)
        others = [arrays[other] for other in sorted(arrays)]
        changed = change(arrays[name].copy(), dice, others)
        if changed is None:
            del arrays[name]
        else:
            arrays[name] = changed
        return f"{name}: {what}"
    path, container, key = dice.choice(leaves)
    if dice.random() < 0.1:
        del container[key]
        return f"{path}: removed"
    container[key] = copy.deepcopy(dice.choice(VALUES))
    return f"{path}: {container[key]!r}"[:100]


def _leaves(value, path="meta"):
    """Where something can be changed: container and key of everything in a JSON value."""
    keys = value.keys() if isinstance(value, dict) else range(len(value))
    for key in list(keys)[:20]:
        yield f"{path}.{key}", value, key
        if isinstance(value[key], dict | list):
            yield from _leaves(value[key], f"{path}.{key}")


def _cast(value, dtype):
    with np.errstate(all="ignore"):
        if dtype.kind == "i" and not abs(value) < 2**63:
            return np.iinfo(dtype).min
        return np.array(value).astype(dtype)


def _filled(array, dice, others):
    array[...] = _cast(dice.choice(NUMBERS), array.dtype)
    return array


def _one(array, dice, others):
    if array.size:
        array.reshape(-1)[dice.randrange(array.size)] = _cast(dice.choice(NUMBERS), array.dtype)
    return array


def _shuffled(array, dice, others):
    np.random.default_rng(dice.randrange(2**32)).shuffle(array.reshape(-1))
    return array


_OF_ARRAYS = (
    ("filled", _filled),
    ("one entry", _one),
    ("one entry again", _one),
    ("shuffled", _shuffled),
    ("removed", lambda array, dice, others: None),
    ("empty", lambda array, dice, others: array[:0] if array.ndim else array.reshape(1)[:0]),
    ("shorter", lambda array, dice, others: array[:-1] if array.ndim else array.reshape(1)),
    ("longer", lambda array, dice, others: np.concatenate((np.atleast_1d(array),) * 2)),
    ("transposed", lambda array, dice, others: array.T),
    ("flat", lambda array, dice, others: array.ravel()),
    ("another dtype", lambda array, dice, others: array.astype(
        dice.choice([np.float32, np.float64, np.int64, np.int8, np.bool_, np.uint64]))),
    ("another array", lambda array, dice, others: dice.choice(others).copy()),
)  # fmt: skip


def main(folder, first, count, robots=""):
    """Forges and uses; prints a JSON line before each, and how it ended after it."""
    results.write_results = lambda folder, *results: None
    if not folder.exists():
        begin("cliff", folder)
    whole, used = folder, resumed
    if robots:
        whole, used = folder.with_name(f"{folder.name}-robot"), decided
        if not whole.exists():
            export_policy(folder, whole)
    arrays, meta = load(whole / CHECKPOINT)
    target = whole.with_name(f"{whole.name}-forged")
    for seed in range(first, first + count):
        dice = random.Random(seed)
        own, own_meta = dict(arrays), copy.deepcopy(meta)
        with np.errstate(all="ignore"):
            what = forged(own, own_meta, dice)
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(whole, target)
        save(target / CHECKPOINT, own, own_meta)
        print(json.dumps([seed, what]), flush=True)
        faulthandler.dump_traceback_later(SECONDS, exit=True)
        with np.errstate(all="ignore"):
            ended = used(target)
        faulthandler.cancel_dump_traceback_later()
        print(json.dumps([seed, ended]), flush=True)


if __name__ == "__main__":
    if sys.argv[2:]:
        main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), *sys.argv[4:])
