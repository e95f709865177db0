(define (domain hall)
  (:predicates (open) (unsafe) (terminal))
  (:functions (x) (reward))
  (:action walk      ; one metre
    :parameters () :precondition (and)
    :effect (and (increase (x) 1) (decrease (reward) 0.5)))
  (:action leap :parameters () :precondition (and (open))
    :effect (and (increase (x) 2)))
  (:process tire :parameters () :precondition (and) :effect (and (decrease (reward) (* #t 0.25))))
  (:event door       ; it leads outside
    :parameters () :precondition (and (> (x) 3))
    :effect (and (increase (reward) (* 2 (x))) (assign (x) 9) (terminal)))
  ; A hole in the floor.
  (:event hole :parameters () :precondition (and (>= (x) 2) (< (x) 2.25))
    :effect (and (unsafe))))
