; A robot in a corridor, in metres: the goal to the right, a pit to the left.
(define (domain corridor)
  (:predicates (unsafe) (terminal))
  (:functions (x) (reward))
  (:action left
    :parameters ()
    :precondition (and (> (x) -4))
    :effect (and (decrease (x) 1) (decrease (reward) 0.1)))
  (:action right
    :parameters ()
    :precondition (and)
    :effect (and (increase (x) 1) (decrease (reward) 0.1)))
  (:action wait
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) 0.1)))
  (:event pit
    :parameters ()
    :precondition (and (<= (x) -3))
    :effect (and (unsafe) (terminal) (decrease (reward) 5)))
  (:event goal
    :parameters ()
    :precondition (and (>= (x) 4))
    :effect (and (terminal) (increase (reward) 5))))
