"""`serp diagnose`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

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
    assert remark["text"].startswith(f"`push-left`, line {line}: write 0.19")
    assert remark["share"] > 0.2
    number = remark["finding"]
    assert (number["kind"], number["written"]) == ("ParameterFinding", 0.39)
    assert number["estimate"] == pytest.approx(0.195, abs=0.01)
    assert all(remark["text"] in text for remark in shown["remarks"])


def test_pictures_are_written(run: Run, misled: Path) -> None:
    result = run("diagnose", str(misled), "--png=a.png", "--svg=a.svg")
    for file in ("a.png", "a.svg"):
        assert file in result.stderr and Path(file).exists()
