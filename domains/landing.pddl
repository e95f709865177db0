; Landing: a lander falls through thick air and has to touch its pad softly.
;
; Left out: everything about how the lander moves. The actions have no effects, and there is no
; process: not even gravity. serp finds out what the engines do, and what the world does by itself,
; while it acts.
;
; What it is for: a task in which ignorance breaks something. What is a crash is known from the
; first step, how to avoid it is not.

(define (domain landing)
  (:requirements :strips :typing :disjunctive-preconditions :numeric-fluents :time)

  (:predicates
    (unsafe)     ; avoided as long as anything else is possible
    (terminal))  ; the episode ends here

  (:functions
    (offset)     ; metres from the middle of the pad, positive to the right
    (height)     ; metres above the ground
    (sideways)   ; metres per second, positive to the right
    (upwards)    ; metres per second
    (reward))

  ; What the robot can do. Nobody has measured what comes of it.

  (:action fall
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action push-left
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action push-right
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action brake
    :parameters ()
    :precondition (and)
    :effect (and))

  ; What is good about the place where a step has led. Each step costs, the more the farther the
  ; pad: down, but over the pad ...
  (:event high
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) (+ 0.02 (* 0.01 (height))))))

  (:event too-far-right
    :parameters ()
    :precondition (and (> (offset) 0.0))
    :effect (and (decrease (reward) (* 0.03 (offset)))))

  (:event too-far-left
    :parameters ()
    :precondition (and (< (offset) 0.0))
    :effect (and (increase (reward) (* 0.03 (offset)))))

  ; ... the lower, the slower: half a metre per second at the ground, and a quarter more for every
  ; metre of height ...
  (:event too-fast
    :parameters ()
    :precondition (and (< (+ (upwards) (* 0.25 (height))) -0.5))
    :effect (and (increase (reward) (* 0.3 (+ 0.5 (+ (upwards) (* 0.25 (height))))))))

  ; ... and without drifting.
  (:event drifting
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) (* 0.05 (* (sideways) (sideways))))))

  ; The gear bears 1 m/s downwards and half of that sideways, and the pad is 4 m wide. A landing ends
  ; the costs. A crash ends them too, so it has to cost more than it could ever save.
  (:event landing
    :parameters ()
    :precondition (and
      (<= (height) 0.0)
      (>= (upwards) -1.0)
      (<= (sideways) 0.5) (>= (sideways) -0.5)
      (<= (offset) 2.0) (>= (offset) -2.0))
    :effect (and (terminal)))

  (:event crash
    :parameters ()
    :precondition (and
      (<= (height) 0.0)
      (or (< (upwards) -1.0)
          (> (sideways) 0.5) (< (sideways) -0.5)
          (> (offset) 2.0) (< (offset) -2.0)))
    :effect (and (decrease (reward) 10.0) (unsafe) (terminal)))

  ; Nobody will find it there.
  (:event lost
    :parameters ()
    :precondition (and
      (> (height) 0.0)
      (or (> (height) 20.0) (> (offset) 10.0) (< (offset) -10.0)))
    :effect (and (decrease (reward) 10.0) (unsafe) (terminal))))
