"""``config.json``: the configuration, command, software versions and machine of a run."""

from __future__ import annotations

import contextlib
import datetime
import functools
import importlib.metadata
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from serp._util.json_files import json_text, read_json
from serp.errors import RunError
from serp.runs.lock import LOCK

FORMAT = 2
"""Raised where a run of before cannot be read any more."""
CONFIG = "config.json"


class _Config(BaseModel):
    """What every ``config.json`` holds, and more."""

    model_config = ConfigDict(strict=True)

    created: str
    command: list[str]
    domain_files: dict[str, str]
    config: dict[str, Any]
    versions: dict[str, Any]
    machine: dict[str, Any]


_PACKAGES = (
    "serp",
    "numpy",
    "torch",
    "gymnasium",
    "numba",
    "scipy",
    "unified-planning",
    "networkx",
    "pymunk",
    "safetensors",
    "stable-baselines3",
)


def config_text(
    config: Mapping[str, Any],
    domain_files: Mapping[str, str],
    command: Sequence[str],
    now: datetime.datetime,
) -> str:
    """Return the text of ``config.json``.

    Args:
        config: The resolved configuration; its ``seed`` is repeated at the top level.
        domain_files: Name of each copy in the run → name of the original file.
        command: The command line.
        now: When the run began, local time.
    """
    return json_text(
        {
            "format": FORMAT,
            "created": now.astimezone().isoformat(timespec="seconds"),
            "command": list(command),
            "seed": config.get("seed"),
            "domain_files": dict(domain_files),
            "config": dict(config),
            "versions": versions(),
            "machine": machine(),
        }
    )


def read_config(folder: Path) -> dict[str, Any]:
    """Read the ``config.json`` of a run: the keys that `config_text` writes."""
    if os.path.isfile(folder):
        raise RunError(f"{folder} is a file; a run is given by its folder.")
    if not os.path.isdir(folder):
        raise RunError(f"there is no run {folder}: no such folder.")
    file = folder / CONFIG
    if not os.path.isfile(file):
        if os.path.lexists(folder / LOCK):
            raise RunError(
                f"the run {folder} was stopped before it began: it has no {CONFIG}, so there is "
                f"nothing to continue. Begin it again, with --out {folder}."
            )
        raise RunError(
            f"{folder} is not a run: it has no {CONFIG}. Give a folder that plan-and-learn wrote."
        )
    about = read_json(file, "Restore it from a copy.")
    version = about.get("format")
    if version != FORMAT:
        versions = about.get("versions")
        wrote = versions.get("serp") if isinstance(versions, dict) else None
        raise RunError(
            f"{file} was written by another version of serp ({wrote or 'unknown'}): it has format "
            f"{version!r}, and this one reads format {FORMAT}. Use that version, or train again."
        )
    try:
        _Config.model_validate(about)
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        name = ".".join(map(str, wrong["loc"]))
        raise RunError(
            f"{file} was not written by serp, or is damaged: {name}: {wrong['msg']}. Restore it "
            "from a copy."
        ) from None
    return about


@functools.cache
def versions() -> Mapping[str, str | None]:
    """Return distribution → installed version (None if not installed), without importing any."""
    found: dict[str, str | None] = {}
    for name in _PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = None
    return found


def machine() -> dict[str, Any]:
    """Return Python version, operating system, kind of processor and number of cores."""
    return {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
    }


def _processor() -> str:
    """Return the model of the processor, as far as the system names it."""
    with contextlib.suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        for line in text.splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
