; Cart-pole with the sign of the motor reversed: wrong on purpose.
;
; Wrong, compared with cartpole.pddl: `push-left` is described as what pushing to the right does,
; and the other way round, as if two wires had been swapped. All else is right.
;
; What it is for: the worst case. The planner does the opposite of what is good, and with
; conviction: following it is worse than acting at random. Whoever learns with this file has to
; find out by itself, and soon, that its advice is not to be had. Don't use it for anything but
; that comparison.

(define (domain cartpole-reversed)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :numeric-fluents :time)

  (:predicates
    (unsafe)     ; avoided as long as anything else is possible
    (terminal))  ; the episode ends here

  (:functions
    (cart-position)   ; metres from the middle of the track, positive to the right
    (cart-velocity)   ; metres per second
    (pole-angle)      ; radians from upright, positive when it leans to the right
    (pole-velocity)   ; radians per second
    (reward))

  ; What the robot can do: each has the effects of the other.

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and
      (increase (cart-velocity) 0.195)
      (decrease (pole-velocity) 0.29)))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and
      (decrease (cart-velocity) 0.195)
      (increase (pole-velocity) 0.29)))

  ; What the world does by itself, right as it is.

  (:process roll
    :parameters ()
    :precondition (and)
    :effect (and (increase (cart-position) (* #t (cart-velocity)))))

  (:process swing
    :parameters ()
    :precondition (and)
    :effect (and (increase (pole-angle) (* #t (pole-velocity)))))

  (:process gravity
    :parameters ()
    :precondition (and)
    :effect (and (increase (pole-velocity) (* #t (* 15.8 (pole-angle))))))

  ; What is good and what is bad: word for word as in cartpole.pddl, so that whoever learns with
  ; this file learns from the same rewards.

  (:event balance
    :parameters ()
    :precondition (and)
    :effect (and (increase (reward) 1.0)))

  (:event lean-right
    :parameters ()
    :precondition (and (> (pole-angle) 0.0))
    :effect (and (decrease (reward) (/ (pole-angle) 0.2618))))

  (:event lean-left
    :parameters ()
    :precondition (and (< (pole-angle) 0.0))
    :effect (and (increase (reward) (/ (pole-angle) 0.2618))))

  (:event off-centre-right
    :parameters ()
    :precondition (and (> (cart-position) 0.0))
    :effect (and (decrease (reward) (* 0.1 (cart-position)))))

  (:event off-centre-left
    :parameters ()
    :precondition (and (< (cart-position) 0.0))
    :effect (and (increase (reward) (* 0.1 (cart-position)))))

  (:event fall
    :parameters ()
    :precondition (and
      (or (> (pole-angle) 0.2618) (< (pole-angle) -0.2618)
          (> (cart-position) 2.4) (< (cart-position) -2.4)))
    :effect (and (decrease (reward) 1.0) (unsafe) (terminal))))
