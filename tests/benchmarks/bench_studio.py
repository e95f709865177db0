"""How long the studio takes from a keystroke to the new planning graph in the page.

    python -m tests.benchmarks.bench_studio [FILE|NAME] [--keys N] [--word WORD]

From the root of a checkout; it needs Chromium and playwright. A digit is typed behind WORD and
deleted again, so that the numbers of the graph change with every key. Printed are the milliseconds
between the event of the key in the browser and the change of the SVG in the page.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from tests.serp.ui.studio.browser import chromium, served

_WATCH = """
() => {
  window.taken = []; let begun = null;
  document.querySelector('.cm-content').addEventListener(
    'keydown', () => { begun = performance.now(); }, true);
  new MutationObserver(() => {
    if (begun !== null && document.querySelector('.serp-graph svg')) {
      window.taken.push(performance.now() - begun); begun = null;
    }
  }).observe(document.querySelector('.serp-graph'), {childList: true, subtree: true});
}
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", default="soccer")
    parser.add_argument("--keys", type=int, default=60)
    parser.add_argument("--word", default="(increase (reward) 10")
    given = parser.parse_args()
    with served(given.name, Path.cwd()) as address, chromium(address) as (page, _):
        page.wait_for_timeout(3_000)
        put_cursor(page, given.word)
        page.evaluate(_WATCH)
        for key in range(given.keys):
            page.keyboard.press("1" if key % 2 == 0 else "Backspace")
            page.wait_for_function(f"window.taken.length > {key}", timeout=10_000)
        taken = page.evaluate("window.taken")
    median, late = np.percentile(taken, (50, 95))
    print(f"{len(taken)} keys: median {median:.0f} ms, 95 % within {late:.0f} ms, "
          f"longest {max(taken):.0f} ms")  # fmt: skip


def put_cursor(page: Any, word: str) -> None:
    """Put the cursor of the editor behind the first occurrence of a word."""
    page.evaluate(
        """word => {
          const id = Number(document.querySelector('.serp-code').id.slice(1));
          const editor = getElement(id).editor, at = editor.state.doc.toString().indexOf(word);
          if (at < 0) throw new Error('the word is not in the file');
          editor.dispatch({selection: {anchor: at + word.length}, scrollIntoView: true});
          editor.focus();
        }""",
        word,
    )


if __name__ == "__main__":
    main()
