"""How well reward and end of a step are predicted: the file beside the adapted model.

    serp plan-and-learn --domain soccer --env-steps 10000 --out runs/soccer
    python -m tests.benchmarks.study_rewards runs/soccer

The steps that the run remembers are learned again, in their order. Each is predicted before it is
learned from. The first table counts all of them, the second one the newest fifth.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from serp.model.flags import APPLICABLE, TERMINAL, going_on
from serp.model.learned.adaptation import ModelAdaptation
from serp.model.learned.transitions import TransitionMemory
from serp.model.transition_model import TransitionModel, Vector
from serp.runs.run import Run
from serp.settings import AdaptationSettings


def replayed(
    model: TransitionModel, settings: AdaptationSettings, memory: TransitionMemory
) -> tuple[Vector, Vector]:
    """Return observed rewards and ends `[N, 2]`, and the predictions of both models `[N, 2, 2]`.

    Steps that are not applicable by the file are left out.
    """
    adaptation = ModelAdaptation(model, settings, np.random.SeedSequence(0))
    states, actions, rewards = memory.states, memory.actions, memory.rewards
    over = memory.over.tolist()
    next_states, seen, predicted = memory.next_states, list[Vector](), list[Vector]()
    for k, action in enumerate(actions.tolist()):
        if action >= 0:
            both = [core.step(states[k], action) for core in (model.core, adaptation.model.core)]
            ends = [1.0 if flags & TERMINAL else 1.0 - going_on(flags) for _, flags in both]
            if all(flags & APPLICABLE for _, flags in both):
                seen.append(np.array([rewards[k], over[k]]))
                predicted.append(np.column_stack(([out[-1] for out, _ in both], ends)))
        adaptation.observe(states[k], action, next_states[k], over[k], float(rewards[k]))
    return np.array(seen), np.array(predicted)


def correlation(predicted: Vector, seen: Vector) -> float:
    """Return the correlation, NaN where one of both never changes."""
    if min(np.ptp(predicted), np.ptp(seen)) == 0.0:
        return np.nan
    return float(np.corrcoef(predicted, seen)[0, 1])


def table(seen: Vector, predicted: Vector) -> str:
    """Return a table of errors and correlations."""
    lines = ["| | file | adapted |", "|---|---|---|"]
    for k, what in enumerate(("reward", "end")):
        errors = ((predicted[:, :, k] - seen[:, None, k]) ** 2).mean(axis=0)
        name = "reward: root mean square error" if k == 0 else "end: Brier score"
        lines.append("| {} | {:.4f} | {:.4f} |".format(name, *(errors if k else errors**0.5)))
        alike = [correlation(predicted[:, m, k], seen[:, k]) for m in (0, 1)]
        lines.append("| {}: correlation | {:.2f} | {:.2f} |".format(what, *alike))
    return "\n".join(lines)


def main() -> None:
    """Print the tables of each run."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs")
    for path in parser.parse_args().runs:
        run = Run(path)
        seen, predicted = replayed(
            run.model, run.made.settings.adaptation, run.adaptation.experience
        )
        newest = slice(len(seen) * 4 // 5, None)
        print(f"## {path.name}: {len(seen)} steps, {int(seen[:, 1].sum())} ends\n")
        print(
            table(seen, predicted),
            table(seen[newest], predicted[newest]),
            sep="\n\n",
            end="\n\n",
            flush=True,
        )


if __name__ == "__main__":
    main()
