; Taxi: a passenger waits at one of four places of a town and wants to go to another one.
; Left out: nothing. Actions that cannot be done are charged for; the planner does not choose them.

(define (domain taxi)
  (:requirements :strips :typing :disjunctive-preconditions :negative-preconditions
                 :numeric-fluents :time)

  (:types place)

  (:predicates
    (waits ?p - place)   ; the passenger stands there
    (wanted ?p - place)  ; where the passenger wants to go
    (aboard)
    (terminal))          ; the episode ends here

  (:functions
    (row)                ; of the taxi: 0 is the highest, 4 the lowest
    (column)             ; 0 on the left, 4 on the right
    (row-of ?p - place) (column-of ?p - place)
    (reward))

  (:action south
    :parameters ()
    :precondition (and (< (row) 4))
    :effect (and (increase (row) 1) (decrease (reward) 1)))

  (:action north
    :parameters ()
    :precondition (and (> (row) 0))
    :effect (and (decrease (row) 1) (decrease (reward) 1)))

  ; Three walls stand between two columns each.
  (:action east
    :parameters ()
    :precondition (and (< (column) 4)
      (not (and (< (row) 2) (= (column) 1)))
      (not (and (> (row) 2) (or (= (column) 0) (= (column) 2)))))
    :effect (and (increase (column) 1) (decrease (reward) 1)))

  (:action west
    :parameters ()
    :precondition (and (> (column) 0)
      (not (and (< (row) 2) (= (column) 2)))
      (not (and (> (row) 2) (or (= (column) 1) (= (column) 3)))))
    :effect (and (decrease (column) 1) (decrease (reward) 1)))

  (:action pick-up
    :parameters (?p - place)
    :precondition (and (waits ?p) (= (row) (row-of ?p)) (= (column) (column-of ?p)))
    :effect (and (not (waits ?p)) (aboard) (decrease (reward) 1)))

  (:action put-down
    :parameters (?p - place)
    :precondition (and (aboard) (= (row) (row-of ?p)) (= (column) (column-of ?p)))
    :effect (and (not (aboard)) (waits ?p) (decrease (reward) 1)))

  (:event arrive
    :parameters (?p - place)
    :precondition (and (waits ?p) (wanted ?p))
    :effect (and (increase (reward) 21) (terminal))))
