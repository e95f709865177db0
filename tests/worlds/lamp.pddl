; Lamps in two rooms.
(define (domain lamp)
  (:types room)
  (:constants hall attic - room)
  (:predicates (lit ?r - room) (unsafe))
  (:functions (heat) (reward))
  (:action switch-on :parameters (?r - room) :precondition (and (not (lit ?r)))
    :effect (and (lit ?r) (increase (heat) 1)))
  (:action wait :parameters () :precondition (and) :effect (and (decrease (heat) 0.5))))
