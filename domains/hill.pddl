; Hill: a car in a valley whose engine is too weak to climb the hill from where it stands. It has
; to back up the other side and take a run-up.
;
; Left out: everything about how the car moves. The actions have no effects, and there is no
; process. With this file alone the planner cannot tell one action from another; serp finds out what
; they do while it acts.
;
; What it is for: a goal that the way leads away from. "Nearer is better" would leave the car at
; the foot of the hill for ever. What the expert says instead is that the car needs energy.

(define (domain hill)
  (:requirements :strips :typing :numeric-fluents :time)

  (:predicates
    (terminal))  ; the episode ends here

  (:functions
    (position)   ; metres, positive to the right: the valley is at -0.5, the top at 1
    (velocity)   ; metres per second, positive to the right
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

  ; What is good about the place where a step has led. Every step costs a little, so the top is
  ; reached soon: where the episode ends, the costs end too. (A reward for every step and a prize
  ; at the top would make the planner wait at the foot of it.)
  (:event time
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) 0.1)))

  ; What is missing is energy. In metres of height, the car's is the height of the road where it is
  ; plus its velocity squared over twice the gravity, and at the top the road is 0.41 m high. To
  ; the left of 0 the road is the parabola x + x * x; to the right it flattens, which the fraction
  ; below says well enough.
  (:event too-little-run-up-left
    :parameters ()
    :precondition (and
      (< (position) 0.0)
      (< (+ (* (position) (+ 1.0 (position))) (/ (* (velocity) (velocity)) 19.62)) 0.41))
    :effect (and (decrease (reward)
      (- 0.41 (+ (* (position) (+ 1.0 (position))) (/ (* (velocity) (velocity)) 19.62))))))

  (:event too-little-run-up-right
    :parameters ()
    :precondition (and
      (>= (position) 0.0)
      (< (+ (/ (position) (+ 1.0 (* 1.45 (position)))) (/ (* (velocity) (velocity)) 19.62)) 0.41))
    :effect (and (decrease (reward)
      (- 0.41 (+ (/ (position) (+ 1.0 (* 1.45 (position)))) (/ (* (velocity) (velocity)) 19.62))))))

  (:event at-the-top
    :parameters ()
    :precondition (and (>= (position) 1.0))
    :effect (and (terminal))))
