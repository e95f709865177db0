"""Find out what is wrong with a domain file that knows no gravity, and write a repaired one."""

from pathlib import Path

import serp

run = serp.plan_and_learn("cartpole-no-gravity", env_steps=600, out="runs/forgetful", quiet=True)

diagnosis = serp.diagnose("runs/forgetful")
for remark in diagnosis.remarks:
    print(f"{remark.share:.0%}", remark.text)
for sentence in diagnosis.unexplained:
    print("not explained:", sentence)

repaired = serp.repair(diagnosis.recorded.domain, diagnosis.worthwhile)
print(f"{len(repaired.changes)} changes")
Path("repaired.pddl").write_text(repaired.text, encoding="utf-8")
