"""The controller of an exported policy, for robots without serp.

It needs Python, NumPy and onnxruntime. `serp export` copies this package into every exported
folder, so it imports nothing else of serp, and its own modules relatively.
"""

from __future__ import annotations

from .controller import Controller as Controller
from .controller import ControllerDecision as ControllerDecision
from .folder import ControllerError as ControllerError
