"""`serp watch`: a trained policy in a window or as a film."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import click

from serp._util.text import plural, readable
from serp.runs import Policy
from serp.ui.asked import open_run
from serp.ui.options import OutputFile, policy_of_run
from serp.ui.output import examples, open_console
from serp.ui.root import say

if TYPE_CHECKING:
    from serp.agent.step_record import StepRecord


@click.command(
    "watch",
    epilog=examples(
        "serp watch runs/seven",
        "serp watch runs/seven --policy planner --episodes 10 --speed 2",
        "serp watch runs/seven --out seven.gif",
        "serp watch runs/seven --episodes 1 --seed 3 --out seven.mp4",
    ),
)
@policy_of_run
@click.option("--episodes", type=click.IntRange(min=1), default=3, show_default=True, metavar="N",
              help="Episodes to show.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the environment; `serp evaluate` has the same episodes.")  # fmt: skip
@click.option("-o", "--out", type=OutputFile(".gif", ".mp4"), metavar="FILE.gif|FILE.mp4",
              help="Write a film there; no screen is needed.  [default: a window]")  # fmt: skip
@click.option("--speed", type=click.FloatRange(min=0.05, max=100), default=1.0,
              show_default=True, metavar="X", help="How much faster than real time.")  # fmt: skip
def command(
    run: Path,
    policy: Policy,
    episodes: int,
    seed: int,
    out: Path | None,
    speed: float,
) -> None:
    """Show episodes of a policy of RUN, the folder that plan-and-learn made.

    Below the picture stands who acts and what is done; in red what was refused, and why in the
    words of the domain file. In the window, Space pauses and Escape closes. The steps are recorded
    in RUN as those of an evaluation, for `serp why`.
    """
    from serp.errors import needs_extra

    with needs_extra("watch", "watching a policy"):
        from serp.ui.pictures.film import FilmSettings, write_film
        from serp.ui.pictures.window import show_film

    is_gif = out is not None and out.suffix.lower() == ".gif"
    fps, width = (50.0, 640) if is_gif else (60.0, None)
    settings = FilmSettings(policy, episodes, seed, speed, fps, width)
    loaded = open_run(run)
    if out is None:
        show_film(loaded, settings, f"{loaded.task.name}, policy {policy}, {run}", _report)
        return
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")  # environments draw with SDL on no screen
    write_film(loaded, out, settings, _report)
    open_console().print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")


def _report(number: int, last: StepRecord) -> None:
    """Say what came of an episode, while the next one is played."""
    from serp.runs.evaluation import outcome_of

    totals, counts = last.episode, last.episode.decisions
    outcome = f"{outcome_of(last.info)}, " if outcome_of(last.info) else ""
    unsafe = f", {plural(counts.unsafe_executed, 'unsafe action')} executed"
    say(
        f"episode {number}: {outcome}return {readable(totals.return_)} in "
        f"{plural(last.number, 'step')}, {plural(counts.vetoes, 'proposal')} refused"
        + (unsafe if counts.unsafe_executed else "")
    )
