; Hill, by somebody who knows where the car should go, and nothing else. (hill.pddl says more: what
; helps on the way there.)
;
; Left out: how the car moves, and what is good about any place but the top. What every action leads
; to within the lookahead is worth the same, so that the planner has no reason for anything until
; the learner has found one.

(define (domain hill)
  (:requirements :strips :typing :numeric-fluents :time)

  (:predicates
    (terminal))  ; the episode ends here

  (:functions
    (position)   ; metres, positive to the right: the valley is at -0.5, the top at 1
    (velocity)   ; metres per second, positive to the right
    (reward))

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
    :effect (and (decrease (reward) 1.0)))

  (:event at-the-top
    :parameters ()
    :precondition (and (>= (position) 1.0))
    :effect (and (terminal))))
