(define (domain robot)
  (:requirements :strips :numeric-fluents :time :math-functions)
  (:predicates (held) (near) (unsafe) (terminal))
  (:functions (x) (speed) (reward))

  ; move
  (:action go
    :parameters ()
    :precondition (and (near) (< (x) 9.5))
    :effect (and
      (increase (x) 1)
      (decrease (reward) 0.5)))

  (:action grab
    :parameters ()
    :precondition (and (near))
    :effect (and (held) (not (near))))

  (:event crash
    :parameters ()
    :precondition (and (> (x) 10))
    :effect (and (unsafe) (terminal)))
)
