"""The comment that belongs to a place."""

from __future__ import annotations

import pytest

from serp.pddl.source import Source, comment_of

TEXT = """; The head of the file.

(define
  (far)     ; what is far, serp: ignore[unused-name]
            ; and farther
  (near)    ; serp: ignore[unused-name]

  ; A goal,
  ;; and its price.
  (goal)

  ; ------------- The end ------------
  (section)

  ; not this one

  (alone) (second) ; of both
  ; at the top (commented) out
  (last))"""


@pytest.mark.parametrize(
    ("form", "comment"),
    [
        ("(far)", "what is far, and farther"),
        ("(near)", ""),
        ("(goal)", "A goal, and its price."),
        ("(section)", ""),
        ("(alone)", "of both"),
        ("(second)", "of both"),
        ("(last)", "at the top (commented) out"),
        ("(define", ""),
    ],
)
def test_the_comment_beside_or_right_above_belongs_to_a_place(form: str, comment: str) -> None:
    source = Source("file", TEXT)
    start = TEXT.index(form)
    assert comment_of(source.place(start, start + len(form))) == comment
