; Cart-pole without gravity: an expert who forgot that a leaning pole falls on its own.
;
; Left out, compared with cartpole.pddl: the process `gravity`. A pole that leans stays as it is
; unless it swings already, or the cart is pushed.
;
; What it is for: to see how little a file has to say. Between two decisions gravity does little,
; and the planner looks again at every step, so this file plans as well as the whole one.
; `serp plan --domain cartpole-no-gravity` shows what it would do.

(define (domain cartpole-no-gravity)
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

  ; What the robot can do, right as it is.

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

  ; What the world does by itself: it moves on. But nothing pulls at the pole.

  (:process roll
    :parameters ()
    :precondition (and)
    :effect (and (increase (cart-position) (* #t (cart-velocity)))))

  (:process swing
    :parameters ()
    :precondition (and)
    :effect (and (increase (pole-angle) (* #t (pole-velocity)))))

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
