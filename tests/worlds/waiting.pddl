; Waiting leads nowhere.
(define (domain waiting)
  (:predicates (open) (terminal))
  (:functions (reward))
  (:action wait :parameters () :precondition (and) :effect (and))
  (:action open :parameters () :precondition (and) :effect (and (open)))
  (:action leave :parameters () :precondition (and (open))
    :effect (and (increase (reward) 10) (terminal))))
