"""`serp watch`: a film of a trained policy."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from serp.runs import Policy
from serp.ui.asked import open_run
from serp.ui.options import OutputFile, policy_of_run
from serp.ui.output import examples, open_console


@click.command(
    "watch",
    epilog=examples(
        "serp watch runs/seven",
        "serp watch runs/seven --episodes 1 --seed 3 --out seven.mp4",
    ),
)
@policy_of_run
@click.option("--episodes", type=click.IntRange(min=1), default=3, show_default=True, metavar="N",
              help="Episodes to show.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N",
              help="Seed of the environment; `serp evaluate` has the same episodes.")  # fmt: skip
@click.option("-o", "--out", type=OutputFile(".mp4"), metavar="FILE.mp4",
              help="The film.  [default: film.mp4 in RUN, which is opened]")  # fmt: skip
def command(run: Path, policy: Policy, episodes: int, seed: int, out: Path | None) -> None:
    """Film episodes of a policy of RUN, the folder that plan-and-learn made.

    Below the picture stands who acts and what is done; in red what was refused, and why in the
    words of the domain file. No screen is needed; on a terminal a film without --out is opened by
    the program for its kind. The steps are recorded in RUN as those of an evaluation, for
    `serp why`.
    """
    from serp.errors import needs_extra

    with needs_extra("watch", "watching a policy"):
        from serp.ui.pictures.film import write_film

    path = out or run / "film.mp4"
    write_film(open_run(run), path, policy, episodes, seed)
    open_console().print(f"{path}: {path.stat().st_size / 1e6:.2f} MB")
    if out is None and sys.stdout.isatty():
        click.launch(str(path))
