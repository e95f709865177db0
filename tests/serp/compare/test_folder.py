"""The folder of a comparison while it is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from serp.compare.folder import writing
from serp.errors import RunError


def test_where_nothing_was_begun_nothing_is_left(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "deep" / "c"
    with pytest.raises(ValueError, match="no"), writing(folder):
        (folder / "domains").mkdir()
        raise ValueError("no")
    assert list(tmp_path.iterdir()) == []


def test_what_was_there_before_stays(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="no"), writing(tmp_path / "runs" / "c"):
        raise ValueError("no")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine", "runs"]


@pytest.mark.parametrize(("name", "what"), [("notes.txt", "other files"), ("config.json", "a run")])
def test_a_folder_that_holds_something_else_is_refused(
    tmp_path: Path, name: str, what: str
) -> None:
    (tmp_path / "domains").mkdir()
    (tmp_path / "domains" / "mine.pddl").write_text("mine")
    (tmp_path / name).write_text("mine")
    with pytest.raises(RunError, match=f"holds {what}, no comparison"), writing(tmp_path):
        pass
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(["domains", name])
    assert (tmp_path / "domains" / "mine.pddl").read_text() == "mine"


def test_an_empty_folder_is_empty_again_where_nothing_was_begun(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no"), writing(tmp_path):
        (tmp_path / "domains").mkdir()
        (tmp_path / "domains" / "walk.pddl").write_text("")
        raise ValueError("no")
    assert [path.name for path in tmp_path.iterdir()] == [".lock"]


def test_what_was_begun_stays_whatever_happens(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with pytest.raises(ValueError, match="no"), writing(folder):
        (folder / "plan.json").write_text("{}")
        raise ValueError("no")
    assert (folder / "plan.json").exists()


def test_one_at_a_time_writes(tmp_path: Path) -> None:
    folder = tmp_path / "c"
    with writing(folder):
        (folder / "plan.json").write_text("{}")
        with pytest.raises(RunError, match="being written by process"), writing(folder):
            pass
        assert folder.exists()
    with writing(folder):
        pass


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "c").write_text("")
    with pytest.raises(RunError, match="cannot write"), writing(tmp_path / "c"):
        pass
    assert (tmp_path / "c").is_file()
