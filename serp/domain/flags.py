"""What a predicted step is like, as bits."""

from __future__ import annotations

APPLICABLE = 1
"""The precondition holds, and there is a next state."""
UNSAFE = 2
"""`(unsafe)` has become true."""
TERMINAL = 4
"""`(terminal)` has become true, or the goal is reached."""
UNDEFINED = 8
"""The precondition does not fail, but the step has no result: something divides by zero, is no
finite number, or contradicts something else. UNSAFE beside it is certain all the same."""
