"""A training in the background: a process of its own."""

from __future__ import annotations

import signal
import subprocess
import threading
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from serp._util.processes import python_command


class BackgroundTraining:
    """A training in a process of its own.

    Args:
        command: Arguments of `serp`, without `--out`.
        run: Folder of the run.
    """

    def __init__(self, command: Sequence[str], run: Path) -> None:
        self.run = run
        self._lines: deque[str] = deque(maxlen=40)
        self._process = subprocess.Popen(
            python_command("serp", *command, "--out", str(run), "--quiet"),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,  # Ctrl-C ends the studio, which then stops the training
        )
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stderr is not None
        with self._process.stderr as lines:
            self._lines.extend(lines)

    @property
    def state(self) -> str:
        """`running`, `ended`, or what the process wrote last where it failed."""
        code = self._process.poll()
        if code is None:
            return "running"
        return "ended" if code in (0, 130) else "".join(self._lines).strip() or f"failed ({code})"

    def stop(self, *, wait: float = 0.0) -> None:
        """Let the training finish its episode and save; after `wait` seconds, if any, end it."""
        if self._process.poll() is not None:
            return
        self._process.send_signal(signal.SIGINT)
        if wait:
            try:
                self._process.wait(wait)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
