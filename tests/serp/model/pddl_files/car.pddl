; PDDL+: a car whose motor pushes it on by itself once it is started, drag that holds it back, a motor
; that breaks when it is driven too fast, and a finish.
(define (domain car)
  (:requirements :typing :numeric-fluents :time :negative-preconditions)
  (:predicates (running) (broken) (unsafe) (terminal))
  (:functions (distance) (speed) (acceleration) (top-speed) (reward))

  (:action start
    :parameters ()
    :precondition (and (not (running)) (not (broken)))
    :effect (and (running)))

  (:action accelerate
    :parameters ()
    :precondition (and (running) (< (acceleration) 2))
    :effect (and (increase (acceleration) 1)))

  (:action brake
    :parameters ()
    :precondition (and (running) (> (acceleration) -2))
    :effect (and (decrease (acceleration) 1)))

  (:action wait
    :parameters ()
    :precondition (and)
    :effect (and))

  (:process moving
    :parameters ()
    :precondition (and (running))
    :effect (and (increase (distance) (* #t (speed)))
                 (increase (speed) (* #t (acceleration)))))

  (:process drag
    :parameters ()
    :precondition (and (running) (> (speed) 0))
    :effect (and (decrease (speed) (* #t (* 0.125 (speed))))))

  (:event breakdown
    :parameters ()
    :precondition (and (running) (> (speed) (top-speed)))
    :effect (and (broken) (unsafe) (assign (acceleration) 0) (not (running))
                 (decrease (reward) 10)))

  (:event finish
    :parameters ()
    :precondition (and (>= (distance) 8))
    :effect (and (terminal) (increase (reward) 5))))
