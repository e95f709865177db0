"""`serp diagnose`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from serp._util.files import finite
from serp.runs.diagnosis import diagnosis as export
from serp.runs.diagnosis.diagnosis import Diagnosis, diagnose
from tests.serp.ui.cli.conftest import QUICK, Run, train

CARTPOLE = Path(__file__).parents[4] / "domains" / "cartpole.pddl"
WRONG = "(decrease (cart-velocity) 0.195)"


def told(run: Run, *arguments: str) -> Any:
    return json.loads(run("diagnose", *arguments, "--json").stdout)


@pytest.fixture(scope="module")
def misled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with a file whose first push is twice as strong as the real one."""
    folder = tmp_path_factory.mktemp("misled")
    text = CARTPOLE.read_text(encoding="utf-8")
    assert text.count(WRONG) == 1
    file = folder / "cartpole.pddl"
    file.write_text(text.replace(WRONG, WRONG.replace("0.195", "0.39")), encoding="utf-8")
    return train(folder / "run", f"--domain={file}", "--episodes=8", *QUICK)


def test_a_wrong_number_is_named_with_its_line_and_its_value(run: Run, misled: Path) -> None:
    before = {path.name: path.read_bytes() for path in misled.iterdir() if path.is_file()}
    text, shown = run("diagnose", str(misled)).stdout, told(run, str(misled))
    assert {path.name: path.read_bytes() for path in misled.iterdir() if path.is_file()} == before
    line = CARTPOLE.read_text(encoding="utf-8").split(WRONG)[0].count("\n") + 1
    (remark,) = (r for r in shown["remarks"] if r["line"] == line)
    effect = WRONG.replace("0.195", "0.39")
    assert remark["text"].startswith(f"`push-left`, line {line}: `{effect}`; observed")
    assert remark["matters"] and remark["share"] > 0.2
    (number,) = (f for f in remark["findings"] if f["kind"] == "ParameterFinding")
    assert number["written"] == 0.39
    assert number["estimate"] == pytest.approx(0.195, abs=0.01)
    # The text has the same as the JSON, and --all has the rest of it.
    assert shown["verdict"] in text and "predicts well" not in text
    in_use = shown["model_in_use"]
    assert in_use == json.loads((misled / "summary.json").read_text())["model"]
    assert f"planned with this model: {in_use['sentence']}" in text
    assert all(fluent["why"] in text for fluent in in_use["fluents"])
    for sentence in shown["not_explained"]:
        assert f"* {sentence}" in text
    everything = run("diagnose", str(misled), "--all").stdout
    for remark in shown["remarks"]:
        assert remark["text"] in everything
        assert (remark["text"] in text) == remark["matters"]


def test_what_is_listed_is_what_is_repaired(run: Run, misled: Path) -> None:
    shown, repaired = told(run, str(misled)), run("repair", str(misled))
    listed = [f for r in shown["remarks"] if r["matters"] for f in r["findings"]]
    numbers = [f for f in listed if f["kind"] == "ParameterFinding"]
    for number in numbers:
        assert f"; {number['parameter']['text']} as written; observed " in repaired.stdout
    assert repaired.stdout.count("as written; observed ") == len(numbers)
    terms = sum(len(f["terms"]) for f in listed if f["kind"] == "MissingEffect")
    assert repaired.stdout.count("; found in ") == terms
    for sentence in shown["not_explained"]:
        assert sentence in repaired.stderr


def test_json_and_pictures_are_those_of_the_diagnosis(
    run: Run, misled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def picture(diagnosis: Diagnosis, kind: str) -> bytes:
        return f"{kind} of {export.as_dict(diagnosis)}".encode()

    monkeypatch.setattr("serp.runs.diagnosis.plots.picture", picture)
    diagnosis = diagnose(misled)
    assert told(run, str(misled)) == json.loads(json.dumps(finite(export.as_dict(diagnosis))))
    result = run("diagnose", str(misled), "--png=a.png", "--svg=a.svg")
    for kind in ("png", "svg"):
        assert f"a.{kind}" in result.stderr
        assert Path(f"a.{kind}").read_bytes() == picture(diagnosis, kind)


def test_a_run_without_adaptation_can_be_diagnosed(run: Run) -> None:
    off = "--set=adaptation.mode=off"
    run("plan-and-learn", "--domain=cartpole", "--episodes=2", "--out=off", off, *QUICK, "--quiet")
    shown = told(run, "off")
    assert shown["steps"] == shown["env_steps"] > 0
    assert not shown["model_in_use"]["adapts"]


def test_usage_errors(run: Run, misled: Path) -> None:
    run("diagnose", expect=2)
    assert "no such folder" in run("diagnose", "nosuch", expect=1).stderr
    for option in ("--png", "--svg"):
        result = run("diagnose", str(misled), option, "numbers.txt", expect=2)
        assert "name a file that ends in ." in result.stderr


def test_a_picture_without_matplotlib_names_the_extra(
    run: Run, misled: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.delitem(sys.modules, "serp.runs.diagnosis.plots", raising=False)
    refused = run("diagnose", str(misled), "--png", "a.png", expect=1)
    assert "pip install 'serp[plots]'" in refused.stderr and not refused.stdout
