"""What an agent says of itself: its trained policy and the evidence for it, and its model."""

from __future__ import annotations

from typing import Any

from serp.training.agent import Agent


def account_of(agent: Agent) -> dict[str, Any]:
    """Return JSON values on an agent as it is now.

    Returns:
        ``trained_policy``: in words, what the policy `serp` does. ``evidence``: why, from the
        returns of planner and learner; null for strategies that do not go by evidence. ``model``:
        which learned parts the planner's model uses, and why others are not in use.
    """
    evidence = agent.strategy.evidence
    return {
        "trained_policy": agent.strategy.choice,
        "evidence": None if evidence is None else evidence.as_dict(),
        "model": agent.adaptation.adoption.as_dict(),
    }
