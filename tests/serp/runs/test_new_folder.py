from __future__ import annotations

import datetime

import pytest

from serp.runs.new_folder import default_path

NOW = datetime.datetime(2026, 11, 21, 4, 5, 6)


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    """The folder in which runs lie."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs").mkdir()


def test_name_and_time_make_the_folder():
    assert default_path("cartpole", NOW).parts == ("runs", "cartpole-20261121-040506")


def test_existing_folders_are_stepped_round():
    names = []
    for _ in range(3):
        path = default_path("cartpole", NOW)
        path.mkdir()
        names.append(path.name)
    first = "cartpole-20261121-040506"
    assert names == [first, f"{first}-2", f"{first}-3"]


def test_a_dangling_link_counts_as_existing(tmp_path):
    first = default_path("cartpole", NOW)
    first.symlink_to(tmp_path / "nowhere")
    assert default_path("cartpole", NOW).name == f"{first.name}-2"


@pytest.mark.parametrize("name", ["../../etc/x", "a/b", "..", "", "größe ρ", "-rf", "C:\\x"])
def test_no_name_leads_out_of_the_root(name):
    path = default_path(name, NOW)
    assert path.parent.parts == ("runs",)
    assert not path.name.startswith(("-", "."))
    path.mkdir()
