"""Resuming a run: its newest checkpoint, and how to go on after an error."""

from __future__ import annotations

import contextlib
import shlex
import warnings
from collections.abc import Iterator

from serp._util.text import plural
from serp.errors import Interrupted, Notice, SettingsError
from serp.model.transition_model import StateError
from serp.runs.checkpoint import NEWEST, PREVIOUS
from serp.runs.folder import METRICS, RunFolder
from serp.runs.run import reading, refuse_changes
from serp.runs.tables import read_metrics
from serp.runs.trainer import Budget, Trainer


def restore(folder: RunFolder, trainer: Trainer, before: Budget) -> Budget:
    """Restore the newest checkpoint, if there is one; return the budget of the run."""
    # A run without a checkpoint and without an episode was stopped before it began.
    if has_checkpoint(folder) or len(read_metrics(folder.path / METRICS)["episode"]):
        checkpoint = folder.resume()
        refuse_changes(folder, checkpoint)
        with reading(checkpoint) as saved:
            trainer.load_state_dict(checkpoint.arrays, checkpoint.meta)
            before = Budget.from_dict(saved.part("budget")[1])
        if checkpoint.fallback is not None:
            warnings.warn(
                f"{checkpoint.fallback} The run goes on from the previous checkpoint, after "
                f"{plural(trainer.env_steps, 'env step')}; what came after it is done again.",
                Notice,
                stacklevel=4,
            )
    return before


def has_checkpoint(folder: RunFolder) -> bool:
    """Return whether a run can be resumed from somewhere."""
    return any((folder.path / name).exists() for name in (NEWEST, PREVIOUS))


@contextlib.contextmanager
def advice_to_resume(folder: RunFolder) -> Iterator[None]:
    """Add to any error of a training how to continue it, if that is possible.

    Settings and domain cannot change in a run, so a run with a wrong one cannot be continued.
    """
    try:
        yield
    except (SettingsError, StateError):
        raise
    except (Exception, KeyboardInterrupt) as error:
        if has_checkpoint(folder):
            kept = f"The run up to the last checkpoint is kept in {folder.path}. "
            error.add_note(
                f"{'' if isinstance(error, Interrupted) else kept}Continue with\n"
                f"  serp plan-and-learn --resume {shlex.quote(str(folder.path))}\n"
                f"or, in Python, plan_and_learn(task, out={str(folder.path)!r}, resume=True)"
            )
        raise
