; Mountain car: a car in a valley whose engine is too weak to climb the hill from where it stands.
;
; Left out: everything but what is wanted. The actions have no effects, there is no process, and
; nothing says that energy helps.
;
; What it is for: a goal that no step comes nearer to. Every step costs the same until the top is
; reached, so serp has to find out how the car moves, and that there is a way up.

(define (domain mountain-car)
  (:requirements :strips :typing :numeric-fluents :time)

  (:predicates
    (terminal))  ; the episode ends here

  (:functions
    (position)   ; the valley is at -0.52, the top on the right at 0.5
    (velocity)   ; change of the position in a step, positive to the right
    (reward))

  ; What the robot can do. Nobody has measured what comes of it.

  (:action drive-left
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action coast
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action drive-right
    :parameters ()
    :precondition (and)
    :effect (and))

  (:event time
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) 1)))

  (:event at-the-top
    :parameters ()
    :precondition (and (>= (position) 0.5) (>= (velocity) 0))
    :effect (and (terminal))))
