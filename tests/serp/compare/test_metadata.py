from __future__ import annotations

from importlib.metadata import version

from serp.compare.metadata import machine, versions


def test_versions_and_machine_are_those_of_this_process():
    found = versions()
    assert found["numpy"] == version("numpy")
    assert None not in found.values()
    assert "core" in machine() and "," in machine()
