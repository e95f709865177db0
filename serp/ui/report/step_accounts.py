"""What is behind the steps of a report: causes, sentences, what was prevented, errors."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from serp._util.terminal import visible
from serp.agent.causes import Cause
from serp.agent.decision import Reason
from serp.agent.explanation import step_causes
from serp.agent.sentences import who_decided, why_refused
from serp.model.flags import APPLICABLE
from serp.model.transition_model import TransitionModel, Vector
from serp.pddl.source import Source
from serp.planning.forecast import SAFE, Bound
from serp.runs.recording import ACTORS, REASONS
from serp.runs.step_account import error_units, in_units, predicted_states
from serp.ui.report.recorded_steps import RecordedSteps

_DECIDES: Final = {
    Reason.UNSAFE: ("unsafe",),
    Reason.NO_SAFE_ACTION: ("unsafe", "risk"),
    Reason.TOO_RISKY: ("risk",),
    Reason.LEAST_RISK: ("risk", "unsafe"),
    Reason.NOT_APPLICABLE: ("failed",),
    Reason.LOW_REWARD: ("reward",),
}
"""Reason → kinds of causes that it is about."""
_UNPLACED: Final = {"learned": "what the run has learned", "chance": "its other outcomes"}
_LABELS: Final = {
    "end": "ends the task",
    "failed": "not applicable",
    "conflict": "contradicts another effect",
    "undefined": "has no value",
}


class StepAccounts:
    """What of the file is behind the executed and the refused action of each step, and sentences.

    Attributes:
        causes: Every distinct cause, without amount and values.
        at: `[N + 1]` where the entries of each step begin.
        action, cause, amount: Of each entry the action of the environment, the position of its
            cause in `causes`, and the amount (0 where a cause has none).
        sentences: The distinct sentences about decisions, with the number of each.
        sentence: `[N]` the number of each step's sentences.
    """

    def __init__(
        self,
        model: TransitionModel,
        steps: RecordedSteps,
        actions: Sequence[str],
        on_step: Callable[[], None],
    ) -> None:
        self._model, self._steps, self._actions = model, steps, actions
        self._numbers: dict[tuple[object, ...], int] = {}
        self._prevented: dict[tuple[int, str], list[int]] = {}
        self.causes: list[Cause] = []
        self.sentences: dict[str, int] = {}
        at, entries, sentence = [0], list[tuple[int, int, float]](), []
        for step, refused in enumerate(steps.vetoed.tolist()):
            executed, proposed = int(steps["action"][step]), int(steps["proposed"][step])
            shown = {executed, proposed if refused else executed} - {-1}
            own = [entry for action in sorted(shown) for entry in self._entries(step, action)]
            entries += own
            at.append(len(entries))
            text = self._decision(step, proposed, executed)
            sentence.append(self.sentences.setdefault(text, len(self.sentences)))
            if refused:
                reason = REASONS[steps["reason"][step]]
                deciding = [
                    (amount, cause)
                    for action, cause, amount in own
                    if action == proposed and self.causes[cause].what in _DECIDES.get(reason, ())
                ]
                key = (min(deciding)[1], "") if deciding else (proposed, str(reason))
                self._prevented.setdefault(key, []).append(step)
            on_step()
        self.at, self.sentence = np.array(at, np.uint32), np.array(sentence, np.uint32)
        self.action = np.array([action for action, _, _ in entries], np.uint16)
        self.cause = np.array([cause for _, cause, _ in entries], np.uint32)
        self.amount = np.array([amount for _, _, amount in entries], np.float64)

    def _entries(self, step: int, action: int) -> list[tuple[int, int, float]]:
        """Return action, cause and amount of each cause of an action in a step."""
        steps = self._steps
        ground, flags = int(steps["ground"][step, action]), int(steps["flags"][step, action])
        if ground < 0:
            return []
        entries = []
        reward = float(steps["reward"][step, action]) if flags & APPLICABLE else None
        for cause in step_causes(self._model, steps["state"][step], ground, flags, reward):
            key = (cause.what, cause.origin, cause.name, cause.text, cause.place)
            if key not in self._numbers:
                self._numbers[key] = len(self.causes)
                self.causes.append(replace(cause, amount=None, reads={}))
            entries.append((action, self._numbers[key], cause.amount or 0.0))
        return entries

    def _decision(self, step: int, proposed: int, executed: int) -> str:
        """Return who decided and why; what of the file is behind a refusal stands beside that."""
        steps, why = self._steps, ""
        reason = REASONS[steps["reason"][step]]
        if steps.vetoed[step] and proposed >= 0:
            safe = int(steps["safe_steps"][step, proposed])
            known = reason is Reason.UNSAFE_AHEAD and 0 <= safe < SAFE
            reward = float(steps["reward"][step, proposed])
            why = why_refused(reason, (), reward, safe if known else None)
        sentences = who_decided(
            reason,
            (self._actions[proposed] if proposed >= 0 else "", ACTORS[steps["proposed_by"][step]]),
            (self._actions[executed], ACTORS[steps["executed_by"][step]]),
            rho=math.nan,
            indifferent=bool(steps["indifferent"][step]),
            bound=Bound(int(steps["bound"][step])),
            why=why,
        )
        return " ".join(sentences)

    def prevented(self, sources: Sequence[Source]) -> list[dict[str, Any]]:
        """Return each distinct thing that vetoes prevented, the most frequent first, for the page.

        A veto is counted for what decided it: the effect that makes the step unsafe or risky, the
        condition that does not hold, of a low reward the largest loss; else for its reason. `steps`
        of a card are its vetoes.
        """
        words = {"reward": "a loss", "unsafe": "unsafe", "risk": "a risk"}
        cards = []
        for (number, reason), where in sorted(self._prevented.items(), key=lambda i: -len(i[1])):
            proposed = Counter(self._actions[self._steps["proposed"][step]] for step in where)
            names = ", ".join(name for name, _ in proposed.most_common(4))
            names += f" and {len(proposed) - 4} more" if len(proposed) > 4 else ""
            about, what = {}, reason.removeprefix("proposal ")
            if not reason:
                cause = self.causes[number]
                about = shown_cause(cause, sources)
                by = "" if cause.origin == "action" else f" by {about['by']}"
                what = words.get(cause.what, about["label"]) + by
            examples = sorted({where[0], where[-1]})
            card = {
                "count": f"{len(where):,} ×",
                "what": f"{names}: {what}",
                "says": f"vetoes of {names}",
                "examples": [{"step": k, "says": self._steps.place_of(k)} for k in examples],
                "steps": where,
            }
            cards.append(about | card)
        return cards


def shown_cause(cause: Cause, sources: Sequence[Source]) -> dict[str, str]:
    """Return the texts about a cause; `line` is the id of its line in the page, or empty."""
    line, place = "", cause.place
    if place is not None:
        numbers = [number for number, source in enumerate(sources) if source.name == place.file]
        line = f"f{numbers[0]}-{place.line}" if numbers else ""
    texts = {
        "kind": cause.what,
        "label": _LABELS.get(cause.what, cause.what),
        "by": _UNPLACED.get(cause.origin, cause.schema),
        "text": cause.text,
        "condition": cause.condition,
        "comment": cause.comment,
        "place": "" if place is None else f"{Path(place.file).name}:{place.line}",
        "line": line,
    }
    return {name: visible(text) for name, text in texts.items()}


@dataclass(frozen=True)
class ModelErrors:
    """Predictions of the model as written, one step ahead.

    Attributes:
        predicted: Next states `[N, F]`; NaN where there is no prediction.
        errors: `[N, F]` absolute errors in units of what a fluent usually changes by in a step
            (root mean square); of predicates 0 or 1; NaN without a prediction.
        large: `[N]` whether an error of a step is at least `limit`.
        limit: Errors from here on are called large: those of a twentieth of the steps, at least 1.
        mean: Root mean square of all errors; None without any.
    """

    predicted: Vector
    errors: Vector
    large: Vector
    limit: float
    mean: float | None


def model_errors(model: TransitionModel, steps: RecordedSteps, usual: Vector) -> ModelErrors:
    """Compare what the model as written predicts with what was observed.

    `usual` `[F]` is what a fluent usually changes by; one that never changes is measured by what it
    is predicted to change by.
    """
    model, states = model.written, steps["state"]
    ground = np.take_along_axis(steps["ground"], steps["action"][:, None], 1)[:, 0]
    predicted = predicted_states(model, states, ground.astype(np.int64))
    changes = np.nan_to_num(predicted - states)
    own = np.sqrt(np.square(changes).sum(axis=0) / max(1, len(changes)))
    units = error_units(model, usual, own)
    errors = in_units(predicted - steps["next_state"], units)
    largest = np.nan_to_num(errors).max(axis=1, initial=0.0)
    limit = max(1.0, float(np.quantile(largest, 0.95))) if len(largest) else 1.0
    known = errors[np.isfinite(errors)]
    mean = float(np.sqrt(np.mean(known**2))) if known.size else None
    return ModelErrors(predicted, errors, largest >= limit, limit, mean)
