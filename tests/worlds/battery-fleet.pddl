; Robots whose batteries and ways the file leaves out.
(define (domain fleet)
  (:requirements :typing :numeric-fluents :time)
  (:types robot)
  (:constants dock - robot)
  (:predicates (unsafe))
  (:functions (battery ?r - robot) (load ?r - robot) (way ?r - robot) (wind) (reward))
  (:action drive
    :parameters (?r - robot)
    :precondition (and)
    :effect (and (increase (way ?r) 0.5)))
  (:action rest
    :parameters (?r - robot)
    :precondition (and)
    :effect (and)))
