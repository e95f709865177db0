"""`serp diagnose`."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from serp._util.json_files import finite
from serp.diagnosis.diagnosis import diagnose
from serp.diagnosis.export import as_dict
from tests.serp.cli.conftest import QUICK, Run

CARTPOLE = Path(__file__).parents[3] / "domains" / "cartpole.pddl"
WRONG = "(decrease (cart-velocity) 0.195)"


def told(run: Run, *arguments: str) -> Any:
    return json.loads(run("diagnose", *arguments, "--json").stdout)


@pytest.fixture(scope="module")
def misled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short run with a file whose first push is twice as strong as the real one."""
    from click.testing import CliRunner

    from serp.cli.root import serp

    folder = tmp_path_factory.mktemp("misled")
    text = CARTPOLE.read_text(encoding="utf-8")
    assert text.count(WRONG) == 1
    file = folder / "cartpole.pddl"
    file.write_text(text.replace(WRONG, WRONG.replace("0.195", "0.39")), encoding="utf-8")
    arguments = ["plan-and-learn", f"--domain={file}", "--episodes=8", f"--out={folder / 'run'}"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("serp.runs.plots.render", lambda figure, kind: b"")
        result = CliRunner().invoke(serp, [*arguments, *QUICK, "--quiet"])
    assert result.exit_code == 0, result.output
    return folder / "run"


def test_a_wrong_number_is_named_with_its_line_and_its_value(run: Run, misled: Path) -> None:
    text = run("diagnose", str(misled)).stdout
    line = CARTPOLE.read_text(encoding="utf-8").split(WRONG)[0].count("\n") + 1
    (remark,) = (r for r in told(run, str(misled))["remarks"] if r["line"] == line)
    effect = WRONG.replace("0.195", "0.39")
    assert remark["text"].startswith(f"`push-left`, line {line}: `{effect}`; observed")
    assert remark["text"] in text
    assert remark["matters"]
    (literal,) = (f for f in remark["findings"] if f["kind"] == "parameter")
    assert literal["written"] == 0.39
    assert literal["estimate"] == pytest.approx(0.195, abs=0.01)
    assert remark["share"] > 0.2


def test_the_verdict_and_what_is_not_explained_are_shown(run: Run, misled: Path) -> None:
    text, shown = run("diagnose", str(misled)).stdout, told(run, str(misled))
    assert shown["verdict"] in text and "predicts well" not in text
    for sentence in shown["not_explained"]:
        assert f"* {sentence}" in text


def test_what_is_listed_is_what_is_repaired(run: Run, misled: Path) -> None:
    shown, repaired = told(run, str(misled)), run("repair", str(misled))
    listed = [remark for remark in shown["remarks"] if remark["matters"]]
    numbers = [f for remark in listed for f in remark["findings"] if f["kind"] == "parameter"]
    for number in numbers:
        assert f"; {number['text']} as written; observed " in repaired.stdout
    assert repaired.stdout.count("as written; observed ") == len(numbers)
    effects = [f["terms"] for r in listed for f in r["findings"] if f["kind"] == "missing-effect"]
    assert repaired.stdout.count("; found in ") == sum(map(len, effects))
    for sentence in shown["not_explained"]:
        assert sentence in repaired.stderr


def test_json_is_what_the_diagnosis_gives(run: Run, misled: Path) -> None:
    assert told(run, str(misled)) == json.loads(json.dumps(finite(as_dict(diagnose(misled)))))


def test_all_lists_everything(run: Run, misled: Path) -> None:
    shown = told(run, str(misled))
    few, everything = (run("diagnose", str(misled), *o).stdout for o in ((), ("--all",)))
    for remark in shown["remarks"]:
        assert remark["text"] in everything
        assert (remark["text"] in few) == remark["matters"]


def test_the_numbers_are_written_as_csv(run: Run, misled: Path) -> None:
    result = run("diagnose", str(misled), "--csv", "numbers.csv")
    assert "numbers.csv" in result.stderr
    head, *rows = csv.reader(Path("numbers.csv").read_text(encoding="utf-8").splitlines())
    assert len(rows) == 2 * (4 + 2)  # fluents, reward and end
    cells = {(row[0], row[1]): dict(zip(head, row, strict=True)) for row in rows}
    wrong = cells["push-left", "cart-velocity"]
    assert float(wrong["rmse_written"]) == pytest.approx(0.195, abs=0.01)
    assert float(wrong["rmse_found"]) < 0.02
    assert float(wrong["run_written_bias"]) == pytest.approx(0.195, abs=0.01)


def test_pictures_are_drawn(run: Run, misled: Path) -> None:
    run("diagnose", str(misled), "--png", "a.png", "--svg", "a.svg")
    assert Path("a.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in Path("a.svg").read_text(encoding="utf-8")


def test_a_run_without_correction_can_be_diagnosed(run: Run) -> None:
    off = "--set=adaptation.mode=off"
    run("plan-and-learn", "--domain=cartpole", "--episodes=2", "--out=off", off, *QUICK, "--quiet")
    shown = told(run, "off")
    assert shown["steps"] == shown["env_steps"] > 0
    written = [row["written"] for row in shown["monitor"]]
    assert written == [row["corrected"] for row in shown["monitor"]]


def test_nothing_is_changed(run: Run, misled: Path) -> None:
    before = {path.name: path.read_bytes() for path in misled.iterdir()}
    run("diagnose", str(misled))
    assert {path.name: path.read_bytes() for path in misled.iterdir()} == before


def test_usage_errors(run: Run, misled: Path) -> None:
    run("diagnose", expect=2)
    for option in ("--csv", "--png", "--svg"):
        result = run("diagnose", str(misled), option, "numbers.txt", expect=2)
        assert "name a file that ends in ." in result.stderr


def test_what_has_no_experience_is_refused(run: Run, trained: Path) -> None:
    assert "no such folder" in run("diagnose", "nosuch", expect=1).stderr
