"""What commands print, whole: one golden text a command.

With SERP_WRITE_GOLDEN=1 the texts are written instead of compared; read the difference before it is
committed. Numbers of a training are not compared, for they differ between processors.
"""

import os
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from serp.ui.root import serp
from tests.serp.ui.cli.conftest import QUICK

GOLDEN = Path(__file__).parents[1] / "golden"
PLAY = """; to the shop and back
1
go shop home
 rest
u 2
walked = 5
s
r
p 2
?
go ho
"""
COMMANDS = {
    "check": "check walk.pddl",
    "format": "format walk.pddl --diff",
    "new": "new robot",
    "plan": "plan --domain walk.pddl --depth 2",
    "play": "play walk.pddl --set planner.name=lookahead",
    "why": "why RUN --episode 1 --step 1",
    "evaluate": "evaluate RUN --episodes 3 --seed 4",
    "watch": "watch RUN --episodes 1 --out film.mp4",
    "report": "report RUN --pictures 3 --out page.html",
    "export": "export RUN -o policy",
    "diagnose": "diagnose RUN",
    "repair": "repair RUN -o repaired.pddl",
    "compare": "compare --domain cartpole --algorithms serp,dqn --env-steps 60 --seeds 1 --jobs 1 "
    "--evaluation-episodes 1 --final-episodes 1 --out 'a comparison' "
    "--set planner.depth=2 --set arbiter.rho=1 --set arbiter.veto_horizon=step",
    "tune": "tune --domain cartpole --algorithm dqn --vary learner.layer_norm=true,false "
    "--env-steps 60 --trials 1 --seeds 1 --jobs 1 --out study",
    "plan-and-learn": " ".join(
        ["plan-and-learn --domain cartpole --episodes 2 --out 'a run'", *QUICK]
    ),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_output_is_the_golden_one(name, walk, request):
    words = shlex.split(COMMANDS[name])
    if of_training := "RUN" in words:
        run = request.getfixturevalue("trained")
        words = [str(run) if word == "RUN" else word for word in words]
    result = CliRunner().invoke(serp, words, input=PLAY if name == "play" else None)
    assert "Traceback" not in result.output
    text = f"$ serp {COMMANDS[name]}\n{result.stdout}--- stderr, status {result.exit_code}\n"
    text += re.sub(r"(?m)^.*[\r\x1b].*\n?|^\|.*\n", "", result.stderr)
    if of_training:
        text = text.replace(str(run), "RUN").replace(f"{Path(__file__).parents[4]}/", "")
    if of_training or name in ("compare", "plan-and-learn", "tune"):
        text = re.sub(r"[−-]?(?<![\w:])\d[\d,]*(\.\d+)?(e[-−+]?\d+)?", "#", text)
        text = re.sub(r"#(?: #)+|< #", "#", re.sub(r"([ ─])+", r"\1", text))
        nouns = "step|episode|(?:unsafe )?action|proposal|number|state|other"
        text = re.sub(rf"(# (?:env )?(?:{nouns}))s?\b", r"\1s", text)  # 1 action, 2 actions
    file = GOLDEN / f"{name}.txt"
    if os.environ.get("SERP_WRITE_GOLDEN"):
        file.write_text(text, encoding="utf-8")
    assert text == file.read_text(encoding="utf-8")
