(define (domain robots)
  (:requirements :typing :numeric-fluents :time)
  (:types robot)
  (:constants r1 r2 - robot)
  (:predicates (lit ?r - robot))
  (:functions (place ?r - robot) (battery ?r - robot) (warmth))
  (:action drive
    :parameters (?r - robot)
    :precondition (and)
    :effect (and
      (increase (place ?r) 1.5)
      (decrease (battery ?r) (+ 0.2 (* 0.1 (place ?r))))))
  (:action light
    :parameters (?r - robot)
    :precondition (and)
    :effect (and (lit ?r)))
  (:process cool
    :parameters ()
    :precondition (and)
    :effect (and (decrease (warmth) (* #t (* 0.5 (warmth)))))))
