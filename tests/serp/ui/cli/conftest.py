"""Running commands as a user does, in an empty folder."""

import pytest
from click.testing import CliRunner

from serp.ui.root import serp
from tests.worlds import text

# Falls soon and learns fast: what a run holds matters here, not how good it is.
QUICK = [
    f"--set={setting}"
    for setting in (
        "arbiter.rho=1",
        "guide.strategy=mixture",
        "planner.depth=1",
        "learner.members=1",
        "learner.epsilon_steps=0",
        "learner.epsilon_end=0.1",
    )
]

WALK = "\n" + text("walk")  # a blank line that `serp format` takes away
WALK_PROBLEM = text("walk-problem")


@pytest.fixture
def run(folder):
    """Run a command line in the working directory."""

    def invoke(*arguments, expect=0):
        result = CliRunner().invoke(serp, arguments)
        assert result.exit_code == expect, result.output
        assert "Traceback" not in result.output
        return result

    yield invoke


@pytest.fixture
def walk(folder):
    """A domain with its problem beside it."""
    file = folder / "walk.pddl"
    file.write_text(WALK)
    (folder / "walk-problem.pddl").write_text(WALK_PROBLEM)
    return file


def train(out, *arguments):
    """Train into a folder."""
    command = ["plan-and-learn", f"--out={out}", "--quiet", *arguments]
    result = CliRunner().invoke(serp, command)
    assert result.exit_code == 0, result.output
    return out


@pytest.fixture(scope="session")
def trained(tmp_path_factory):
    """A short run of cart-pole."""
    out = tmp_path_factory.mktemp("runs") / "trained"
    return train(out, "--domain=cartpole", "--episodes=4", *QUICK)
