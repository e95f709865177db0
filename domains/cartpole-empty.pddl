; Cart-pole of an expert who knows nothing of how cart and pole move.
;
; Left out, compared with cartpole.pddl: all of it. The actions have names and no effects, there is
; no process, and the world is predicted to stay as it is. What is good and what is bad is said in
; full.
;
; What it is for: the least that a file can say. To this planner all actions are the same, and what
; it proposes is worth nothing until the model has found out from its own errors what the actions do.

(define (domain cartpole-empty)  ; serp: ignore-file[unused-name]
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

  ; What the robot can do. Nobody has measured what comes of it.

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and))

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
