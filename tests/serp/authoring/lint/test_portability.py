"""Other PDDL tools read what is shipped."""

from __future__ import annotations

from pathlib import Path

import pytest
from unified_planning.io import PDDLReader

pytestmark = pytest.mark.filterwarnings("ignore::Warning")  # of unified-planning's parser
SHIPPED = sorted((Path(__file__).resolve().parents[4] / "domains").glob("*.pddl"))


@pytest.mark.parametrize("file", SHIPPED, ids=lambda path: path.name)
def test_what_is_shipped_is_portable(file: Path) -> None:
    if not file.stem.endswith("-problem"):
        sibling = file.with_name(f"{file.stem}-problem.pddl")
        PDDLReader().parse_problem(str(file), str(sibling) if sibling.exists() else None)
