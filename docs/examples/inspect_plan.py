"""One decision of the planner, with the planning graph behind it."""

import serp

task = serp.load_task("cartpole")
model = task.load().model.replace(dt=task.dt)
planner = serp.MonitorReplanner(model, depth=5)
plan = planner.plan([0.0, 0.0, 0.05, 0.0])  # the pole leans to the right

print(plan.name, plan.safe, plan.graph.number_of_nodes())
print([step.action for step in plan.path])
# prints:
# push-right True 63
# ['push-right', 'push-right', 'push-right', 'push-left', 'push-left']
