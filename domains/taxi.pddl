; Taxi: a town of five by five squares; a passenger waits at one of four places and wants to go to
; another one. Everything is in this file; rewards are those of the environment.

(define (domain taxi)
  (:requirements :strips :typing :disjunctive-preconditions :negative-preconditions
    :numeric-fluents)

  (:types place)

  (:predicates
    (waits ?p - place)   ; the passenger stands there
    (wanted ?p - place)  ; where the passenger wants to go
    (aboard)
    (terminal))

  (:functions
    (row)                ; 0 is the highest, 4 the lowest
    (column)             ; 0 on the left, 4 on the right
    (row-of ?p - place)
    (column-of ?p - place)
    (reward))

  (:action south
    :precondition (< (row) 4)
    :effect (and (increase (row) 1) (decrease (reward) 1)))

  (:action north
    :precondition (> (row) 0)
    :effect (and (decrease (row) 1) (decrease (reward) 1)))

  ; Three walls stand between two columns each.
  (:action east
    :precondition (and (< (column) 4)
      (not (and (< (row) 2) (= (column) 1)))
      (not (and (> (row) 2) (or (= (column) 0) (= (column) 2)))))
    :effect (and (increase (column) 1) (decrease (reward) 1)))

  (:action west
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
    :precondition (and (aboard) (wanted ?p) (= (row) (row-of ?p)) (= (column) (column-of ?p)))
    :effect (and (not (aboard)) (waits ?p) (increase (reward) 20) (terminal))))
