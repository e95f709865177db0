"""Compare SErP with its planner alone and its learner alone; real comparisons need 5 seeds."""

import serp

comparison = serp.compare(
    "cartpole",
    algorithms=["serp", "mrp", "dqn"],
    seeds=1,
    env_steps=200,
    evaluate_every=100,
    evaluation_episodes=2,
    final_episodes=2,
    out="runs/comparison",
    jobs=1,
    quiet=True,
)
head, rows = comparison.overview()
for row in (head, *rows):
    print(" | ".join(row))
print("report:", comparison.path / "report.html")
