"""Read what a run left behind: metrics, decisions, and the trained agent."""

import csv
from collections import Counter

import serp

run = serp.plan_and_learn("cartpole", env_steps=600, out="runs/balance", quiet=True)

run = serp.load_run("runs/balance")  # the same, from the folder
print("episodes:", run.summary["episodes"], "returns:", run.metrics["return"].tolist())

with open(run.path / "decisions.csv", newline="", encoding="utf-8") as file:
    reasons = Counter(row["reason"] for row in csv.DictReader(file))
print("most frequent reason:", reasons.most_common(1)[0][0])

decision = run.decide([0.0, 0.0, 0.05, 0.0])
print("leaning right:", decision.action, "by", decision.executed_by, "unsafe:", decision.unsafe)
