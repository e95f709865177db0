; Cart-pole of an expert who ignores velocities: a push moves cart and pole, and that is that.
;
; Left out, compared with cartpole.pddl: that what moves goes on moving. Here a push *sets* both
; velocities to what it brings about from rest, whatever the sensors have measured. A pole that
; falls to the right at full speed is predicted to turn round at once.
;
; What it is for: a guide that is half right. It says which push is good for which lean, but
; pushes too late and swings up what it should calm down. It must be improved before it is useful.

(define (domain cartpole-no-velocity)
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

  ; What the robot can do. `assign` forgets what was there before; `increase` would not.

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and
      (assign (cart-velocity) -0.195)
      (assign (pole-velocity) 0.29)))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and
      (assign (cart-velocity) 0.195)
      (assign (pole-velocity) -0.29)))

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
