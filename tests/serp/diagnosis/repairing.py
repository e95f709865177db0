"""Findings made up for a file, and what is to be said of a repaired one."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

from serp.diagnosis.diagnosis import make_diagnosis
from serp.diagnosis.estimation import findings
from serp.diagnosis.findings import Findings, ParameterFinding
from serp.diagnosis.recorded_run import Recorded
from serp.diagnosis.repair.repair import Repaired, repair
from serp.model.loading import Domain
from serp.sysid.monitor import Monitor
from serp.sysid.parameter_dependencies import parameter_dependencies
from serp.sysid.transitions import TransitionMemory
from tests.serp.sysid.rolls import from_text


def literal(
    domain: Domain, position: int, estimate: float, error: float = 0.01
) -> ParameterFinding:
    """The finding that a literal is another number."""
    influence = parameter_dependencies(domain.model.ground)[position]
    parameter = influence.parameter
    return ParameterFinding(
        parameter, influence.schema, influence.symbol, parameter.value, estimate, error, 412, 1.0
    )


def of(*literals: ParameterFinding, **others: tuple[object, ...]) -> Findings:
    """Findings of some kinds and no others."""
    found = Findings(literals, (), (), (), 412, 0)
    return dataclasses.replace(found, **others)


def taken(domain: Domain, experience: TransitionMemory, dt: float = 1.0) -> Recorded:
    """What a run has recorded, but for its monitor."""
    model = domain.model.replace(dt=dt)
    return Recorded(
        run=Path("runs/seven"), domain=domain, files={}, model=model, experience=experience,
        monitor=Monitor(model), env_steps=len(experience), learned_from="domain", notice=None,
    )  # fmt: skip


def repaired_by(domain: Domain, experience: TransitionMemory, dt: float) -> Repaired:
    """The domain repaired by what was observed."""
    recorded = taken(domain, experience, dt)
    diagnosis = make_diagnosis(recorded, findings(recorded.model, experience))
    return repair(domain, diagnosis.worthwhile, diagnosis.unexplained)


def written(domain: Domain, repaired: Repaired) -> Domain:
    """The repaired domain, with the problem of the old one."""
    problem = None if domain.problem_source is None else domain.problem_source.text
    return from_text(repaired.text, problem)


TOKEN = re.compile(r";[^\n]*|[()\s]|[^\s();]+")
CHANGED = re.compile(r"increase|decrease|assign|-?\d+(\.\d+)?")


def tokens(text: str) -> list[str]:
    """Comments, words, brackets and white space; numbers, and words that turn them, are alike."""
    return ["#" if CHANGED.fullmatch(token) else token for token in TOKEN.findall(text)]


def kept(old: str, new: str) -> bool:
    """Whether the old text is still there, in order, but for numbers and the words around them."""
    rest = iter(tokens(new))
    return all(token in rest for token in tokens(old))


def comments(text: str) -> list[str]:
    """The comments, one for each line that has one."""
    return [line[line.index(";") :] for line in text.splitlines() if ";" in line]


def logic(domain: Domain) -> list[tuple[str, str]]:
    """Everything of a file that no repair may touch: conditions, events, rewards and flags."""
    found = []
    for schema in domain.syntax.schemas:
        if schema.kind.value == "event":
            found.append((schema.name, schema.place.text))
        elif schema.precondition is not None and not schema.name.endswith("-changes"):
            found.append((schema.name, schema.precondition.place.text))
    lines = domain.source.text.splitlines()
    return found + [
        ("", line.rstrip(" )")) for line in lines if "(unsafe)" in line or "(reward)" in line
    ]
