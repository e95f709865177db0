; Frozen lake: a walk over ice from the upper left to the lower right corner, around holes.
;
; Left out: that the ice is slippery. Two of three moves go astray, to the left or to the right of
; where they were meant to go; this file says that they go where they were meant to.
;
; What it is for: chance that a plan has to reckon with. The way that the file takes for the best
; leads past holes; serp finds out how often a move goes astray.

(define (domain frozen-lake)
  (:requirements :strips :typing :conditional-effects :disjunctive-preconditions
                 :numeric-fluents :time)

  (:predicates
    (terminal))   ; the episode ends here

  (:functions
    (row)         ; 0 is the highest, 7 the lowest
    (column)      ; 0 on the left, 7 on the right
    (reward))

  (:action left
    :parameters ()
    :precondition (and)
    :effect (and (when (> (column) 0) (decrease (column) 1))))

  (:action down
    :parameters ()
    :precondition (and)
    :effect (and (when (< (row) 7) (increase (row) 1))))

  (:action right
    :parameters ()
    :precondition (and)
    :effect (and (when (< (column) 7) (increase (column) 1))))

  (:action up
    :parameters ()
    :precondition (and)
    :effect (and (when (> (row) 0) (decrease (row) 1))))

  ; The holes of the standard map.
  (:event fall
    :parameters ()
    :precondition (and (or
      (and (= (row) 2) (= (column) 3)) (and (= (row) 3) (= (column) 5))
      (and (= (row) 4) (= (column) 3)) (and (= (row) 5) (= (column) 1))
      (and (= (row) 5) (= (column) 2)) (and (= (row) 5) (= (column) 6))
      (and (= (row) 6) (= (column) 1)) (and (= (row) 6) (= (column) 4))
      (and (= (row) 6) (= (column) 6)) (and (= (row) 7) (= (column) 3))))
    :effect (and (terminal)))

  (:event arrive
    :parameters ()
    :precondition (and (= (row) 7) (= (column) 7))
    :effect (and (increase (reward) 1) (terminal))))
