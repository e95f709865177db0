"""The planner `pyperplan`: symbolic domains with a goal, solved by the searches of pyperplan.

pyperplan (https://github.com/aibasel/pyperplan) is free software under the GPL 3. Importing this
package without it raises `serp.errors.MissingExtra`.
"""

from importlib.util import find_spec

from serp.errors import MissingExtra

if find_spec("pyperplan") is None:
    raise MissingExtra("the planner `pyperplan`", "pyperplan")

from serp_adapters.pyperplan.planner import make as make
