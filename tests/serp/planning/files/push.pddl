; A player pushes boxes onto the cells that the goal names.
(define (domain push)
  (:requirements :typing :negative-preconditions)
  (:types cell direction)
  (:constants north south west east - direction)
  (:predicates (player ?c - cell) (box ?c - cell) (next ?a ?b - cell ?d - direction))
  (:action walk
    :parameters (?from ?to - cell ?d - direction)
    :precondition (and (player ?from) (next ?from ?to ?d) (not (box ?to)))
    :effect (and (not (player ?from)) (player ?to)))
  (:action push
    :parameters (?from ?to ?beyond - cell ?d - direction)
    :precondition (and (player ?from) (next ?from ?to ?d) (next ?to ?beyond ?d)
                       (box ?to) (not (box ?beyond)))
    :effect (and (not (player ?from)) (player ?to) (not (box ?to)) (box ?beyond))))
