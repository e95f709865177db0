; Cart-pole of an expert who only knows how the cart moves.
;
; Left out, compared with cartpole.pddl: that pushing the cart turns the pole, and gravity. The
; pole swings on as it does, whatever the robot may do.
;
; What it is for: a guide that is right in all it says and says nothing of what matters. Its
; planner keeps the cart in the middle of the track and watches the pole fall.

(define (domain cartpole-cart-only)
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

  ; What the robot can do: to the cart.

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and
      (decrease (cart-velocity) 0.195)))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and
      (increase (cart-velocity) 0.195)))

  ; What the world does by itself.

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
