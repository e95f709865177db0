"""`serp why`."""

import json

import numpy as np
import pytest

from serp.planning.forecast import Bound
from serp.runs.recording import open_recording
from tests.serp.ui.cli.conftest import QUICK, train
from tests.worlds import DOMAINS


def explained(run, *arguments):
    return json.loads(run("why", *arguments, "--json").stdout)


def test_a_step_is_the_same_however_it_is_asked_for(run, trained):
    recording = open_recording(trained)
    step = int(recording.episodes[3][4])
    asked = str(trained), "--episode=3"
    shown = explained(run, str(trained), f"--step={step}")
    assert shown == explained(run, *asked, "--step=4")
    decision = recording.step(step).decision
    values = [each["best_return"] for each in shown["account"]["alternatives"]]
    if decision.forecast.bound is Bound.SAFETY:
        assert np.isfinite(values).all()  # nothing was planned, so it is planned now
    else:
        assert values == decision.forecast.value.tolist()
    assert shown["executed"] == recording.layout.actions[decision.action]
    assert (shown["step"], shown["episode"], shown["number"]) == (step, 3, 4)
    run("evaluate", str(trained), "--episodes=1", "--seed=3")
    shown = explained(run, str(trained), "--evaluation=serp-seed3", "--step=0")
    assert (shown["step"], shown["episode"], shown["number"]) == (0, 1, 0)


CARTPOLE = DOMAINS / "cartpole.pddl"
WRONG = "(decrease (cart-velocity) 0.195)"


def told(run, *arguments):
    return json.loads(run("diagnose", *arguments, "--json").stdout)


@pytest.fixture(scope="module")
def misled(tmp_path_factory):
    """A short run with a file whose first push is twice as strong as the real one."""
    folder = tmp_path_factory.mktemp("misled")
    text = CARTPOLE.read_text(encoding="utf-8")
    assert text.count(WRONG) == 1
    file = folder / "cartpole.pddl"
    file.write_text(text.replace(WRONG, WRONG.replace("0.195", "0.39")), encoding="utf-8")
    return train(folder / "run", f"--domain={file}", "--episodes=8", *QUICK)


def test_a_wrong_number_is_named_with_its_line_and_its_value(run, misled):
    before = {path.name: path.read_bytes() for path in misled.iterdir() if path.is_file()}
    text, shown = run("diagnose", str(misled), "--all").stdout, told(run, str(misled))
    assert {path.name: path.read_bytes() for path in misled.iterdir() if path.is_file()} == before
    line = CARTPOLE.read_text(encoding="utf-8").split(WRONG)[0].count("\n") + 1
    (remark,) = (r for r in shown["remarks"] if r["line"] == line)
    assert remark["text"].startswith(f"`push-left`, line {line}: write 0.19")
    assert remark["share"] > 0.2
    number = remark["finding"]
    assert (number["kind"], number["written"]) == ("ParameterFinding", 0.39)
    assert number["estimate"] == pytest.approx(0.195, abs=0.01)
    assert all(remark["text"] in text for remark in shown["remarks"])
