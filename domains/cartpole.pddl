; Cart-pole: keep a pole upright on a cart that can only be pushed to the left or to the right.
;
; This file is all that serp knows about the task. You can edit it without knowing Python; after an
; edit, `serp check domains/cartpole.pddl` tells whether it still makes sense, and
; `serp plan --domain cartpole` shows what the planner would do with it.
;
; How to read it. PDDL puts everything in parentheses, the operator first: (+ 1 2) is 1 + 2. What
; follows a semicolon is a comment. Units here: metres, seconds, radians.
;
; The description is *partial*, and that is fine: it is a rough, linear picture of the physics that
; an engineer can write in ten minutes. The learner finds out the rest.

(define (domain cartpole)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :numeric-fluents :time)

  ; Things that are true or false. Both names are reserved by serp: in every step they start false,
  ; and what makes them true tells serp something.
  (:predicates
    (unsafe)     ; "this damages the robot": serp avoids it as long as anything else is possible
    (terminal))  ; the episode ends here

  ; Things that have a number. The first four are measured by the robot's sensors.
  (:functions
    (cart-position)   ; metres from the middle of the track, positive to the right
    (cart-velocity)   ; metres per second
    (pole-angle)      ; radians from upright, positive when it leans to the right
    (pole-velocity)   ; radians per second
    (reward))         ; reserved: what it gains in a step is the reward of the step

  ; What the robot can do. A push lasts one control period (0.02 s) and changes both velocities at
  ; once: pushing the cart to the left makes the pole swing to the right.

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and
      (decrease (cart-velocity) 0.195)
      (increase (pole-velocity) 0.29)))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and
      (increase (cart-velocity) 0.195)
      (decrease (pole-velocity) 0.29)))

  ; What the world does by itself, all the time. #t is the time that passes, so (* #t rate) is a
  ; change of so much per second.

  (:process roll
    :parameters ()
    :precondition (and)
    :effect (and (increase (cart-position) (* #t (cart-velocity)))))

  (:process swing
    :parameters ()
    :precondition (and)
    :effect (and (increase (pole-angle) (* #t (pole-velocity)))))

  (:process gravity            ; the farther the pole leans, the faster it falls
    :parameters ()
    :precondition (and)
    :effect (and (increase (pole-velocity) (* #t (* 15.8 (pole-angle))))))

  ; What happens at thresholds. Events are checked after every step, once the world has moved on.
  ; Here they say what is good and what is bad about the place where the step has led.

  (:event balance              ; one point for every step.
    :parameters ()
    :precondition (and)
    :effect (and (increase (reward) 1.0)))

  (:event lean-right           ; the cost is the lean as a fraction of the 15 degrees that are allowed.
    :parameters ()
    :precondition (and (> (pole-angle) 0.0))
    :effect (and (decrease (reward) (/ (pole-angle) 0.2618))))

  (:event lean-left
    :parameters ()
    :precondition (and (< (pole-angle) 0.0))
    :effect (and (increase (reward) (/ (pole-angle) 0.2618))))

  (:event off-centre-right     ; costs a tenth of the distance from the middle.
    :parameters ()
    :precondition (and (> (cart-position) 0.0))
    :effect (and (decrease (reward) (* 0.1 (cart-position)))))

  (:event off-centre-left
    :parameters ()
    :precondition (and (< (cart-position) 0.0))
    :effect (and (increase (reward) (* 0.1 (cart-position)))))

  ; The end: the pole has fallen (beyond 15 degrees), or the cart has hit the end of the track.
  (:event fall
    :parameters ()
    :precondition (and
      (or (> (pole-angle) 0.2618) (< (pole-angle) -0.2618)
          (> (cart-position) 2.4) (< (cart-position) -2.4)))
    :effect (and (decrease (reward) 1.0) (unsafe) (terminal))))
