"""Tuning: what is asked for is searched, and a study that goes on is the one that began."""

import json
import os
import signal

import pytest
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

from serp.errors import Interrupted, RunError, SerpError
from serp.runs.run import load_run
from serp.runs.train import StoppedAtOnce
from serp.runs.tuning import tune
from serp.runs.tuning_space import space_of
from tests.serp.runs.comparison.contest import Pothole, Walk, walk

VARY = {"learner.learning_rate": "log:1e-4..1e-1", "learner.hidden": [[8], [16, 16]]}


def tuned(folder, name, **options):
    given = {"vary": VARY, "env_steps": 40, "seeds": 2, "jobs": 1, "quiet": True}
    task = options.pop("task", None) or walk(folder)
    return tune(task, **{**given, "out": folder / name, **options})


class Interrupting(Walk):
    """Sends its process signals, one at each step."""

    def __init__(self, signals):
        super().__init__()
        self.signals = signals

    def step(self, action):
        if self.signals:
            os.kill(os.getpid(), self.signals.pop())
        return super().step(action)


def interrupted(folder, name, **options):
    """Tune until Ctrl-C, until Ctrl-C twice, and in a process that is killed; all in a trial."""

    def on(*signals):
        left = list(signals)
        return walk(folder, lambda: Interrupting(left))

    with pytest.raises(Interrupted):
        tuned(folder, name, task=on(signal.SIGINT), **options)
    with pytest.raises(StoppedAtOnce):
        tuned(folder, name, task=on(signal.SIGINT, signal.SIGINT), **options)
    child = os.fork()
    if child == 0:
        tuned(folder, name, task=on(signal.SIGKILL), **options)
    assert os.WTERMSIG(os.waitpid(child, 0)[1]) == signal.SIGKILL


def test_a_study_finds_the_best_and_one_that_goes_on_equals_an_uninterrupted_one(tmp_path):
    whole = tuned(tmp_path, "whole", trials=3)
    if hasattr(os, "fork"):
        interrupted(tmp_path, "parts", trials=3)
    tuned(tmp_path, "parts", trials=1)
    parts = tuned(tmp_path, "parts", trials=3)
    for name in ("params", "value"):
        values = [getattr(trial, name) for trial in whole.study.trials]
        assert values == [getattr(trial, name) for trial in parts.study.trials]
    assert whole.before == parts.before == whole.study.trials[0].value
    assert whole.value == max(trial.value for trial in whole.study.trials)
    assert whole.gain == parts.gain
    assert whole.gain is not None
    assert whole.gain[0] == pytest.approx(whole.value - whole.before)
    assert whole.settings["learner"]["hidden"] in ((8,), (16, 16))
    run = load_run(whole.path / "trials" / "2-1000", walk(tmp_path))
    hidden = json.loads(whole.study.trials[2].params["learner.hidden"])
    assert run.config["settings"]["learner"]["hidden"] == hidden
    with pytest.raises(RunError, match="holds a study of another task, or with other"):
        tuned(tmp_path, "whole", trials=5, seeds=[1000, 1002])


def test_trials_that_fail_are_reported_and_others_go_on(tmp_path, capsys):
    with pytest.raises(RunError, match="none of 1 trials succeeded; .* cable cut"):
        tuned(tmp_path, "a", task=walk(tmp_path, Pothole), seeds=[1], trials=1)
    vary = {"planner.name": ["lookahead", "nosuch"]}
    found = tuned(tmp_path, "b", vary=vary, trials=4, seeds=1, quiet=False)
    states = {t.state.name for t in found.study.trials}
    shown = capsys.readouterr().err
    assert states == {"COMPLETE", "FAIL"}, shown
    assert "failed. seed 1000: planner.name: there is no planner `nosuch`" in shown
    assert found.trials == 4


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("planner.depth", "2..7", IntDistribution(2, 7)),
        ("planner.discount", "0.5..0.99", FloatDistribution(0.5, 0.99)),
        ("learner.learning_rate", " log:1e-4 .. 1e-2", FloatDistribution(1e-4, 1e-2, log=True)),
        ("learner.target_polyak", "none,1", CategoricalDistribution(["null", "1.0"])),
        ("learner.hidden", "[64,64],[8]", CategoricalDistribution(["[64, 64]", "[8]"])),
        ("arbiter.veto_horizon", "step", CategoricalDistribution(['"step"'])),
    ],
)
def test_types_and_values_follow_from_the_settings(name, given, expected):
    assert space_of({name: given}) == {name: expected}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"vary": {}}, "give the settings to tune"),
        ({"vary": {"learner.member": "2"}}, "no setting `learner.member`; did you mean `members`"),
        ({"vary": {"planner.depth": None}}, "planner.depth: give the values: A..B"),
        ({"vary": {"planner.depth": "0..3"}}, "planner.depth must be greater than or equal to 1"),
        ({"vary": {"planner.depth": "3..3"}}, "the first smaller than the second"),
        ({"vary": {"learner.learning_rate": "log:1..0.5"}}, "with `log:`, above 0"),
        ({"vary": {"arbiter.veto_horizon": "step,l1"}}, "must be 'step' or 'lookahead', not 'l1'"),
        ({"algorithm": "ppo"}, "`ppo`"),
        ({"objective": "fun"}, "tune.objective must be 'training' or 'evaluation'"),
        ({"out": "."}, "is not empty"),
    ],
)
def test_what_cannot_be_tuned_is_refused_before_anything_runs(tmp_path, options, message):
    with pytest.raises(SerpError, match=message):
        tuned(tmp_path, "a", **options)
    assert not (tmp_path / "a").exists()
