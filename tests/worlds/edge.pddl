; Beyond 3 it falls.
(define (domain edge)
  (:predicates (unsafe))
  (:functions (x) (reward))
  (:action step :parameters () :precondition (< (x) 9) :effect (and (increase (x) 1)))
  (:action leap :parameters () :precondition (< (x) 9) :effect (and (increase (x) 2)))
  (:event fall :parameters () :precondition (and (> (x) 3)) :effect (and (unsafe))))
