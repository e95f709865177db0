"""What connects serp to the outside: tasks, planner engines, learner libraries."""

from __future__ import annotations
