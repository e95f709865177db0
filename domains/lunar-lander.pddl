; Lunar lander: a craft with three engines has to come down softly on a pad between hills.
;
; Left out: everything about how the lander moves. The file says what good flying looks like.
;
; What it is for: hints. The environment's prize lies hundreds of steps ahead; speed, lean and spin
; that are wanted *here and now* are what ten steps of looking ahead can see.

(define (domain lunar-lander)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :numeric-fluents :time)

  (:types leg)
  (:constants left-leg right-leg - leg)

  (:predicates
    (touches ?l - leg)
    (unsafe)      ; avoided as long as anything else is possible
    (terminal))   ; the episode ends here

  (:functions
    (offset)      ; metres from the middle of the pad, positive to the right
    (height)      ; metres above the pad
    (sideways)    ; metres per second, positive to the right
    (upwards)     ; metres per second
    (lean)        ; radians from upright, positive to the left
    (spin)        ; radians per second
    (reward))

  ; What the robot can do, and the fuel that it takes. Nobody has measured what comes of it.

  (:action fall :parameters () :precondition (and) :effect (and))
  (:action push-left :parameters () :precondition (and) :effect (and (decrease (reward) 0.03)))
  (:action brake :parameters () :precondition (and) :effect (and (decrease (reward) 0.3)))
  (:action push-right :parameters () :precondition (and) :effect (and (decrease (reward) 0.03)))

  ; The higher, the faster it may come down.
  (:event wrong-speed
    :parameters ()
    :precondition (and (or (not (touches left-leg)) (not (touches right-leg))))
    :effect (and (decrease (reward) (*
      (+ (upwards) (+ 0.5 (* 0.4 (height)))) (+ (upwards) (+ 0.5 (* 0.4 (height))))))))

  ; It should lean against where it is and where it drifts to, and turn there without haste.
  (:event wrong-spin
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) (*
      (+ (spin) (* 1.5 (- (lean) (+ (* 0.08 (offset)) (* 0.12 (sideways))))))
      (+ (spin) (* 1.5 (- (lean) (+ (* 0.08 (offset)) (* 0.12 (sideways))))))))))

  (:event hard-landing
    :parameters ()
    :precondition (and (< (height) 0.2)
      (or (< (upwards) -2.5) (> (lean) 0.5) (< (lean) -0.5)))
    :effect (and (decrease (reward) 100) (unsafe)))

  (:event lost
    :parameters ()
    :precondition (and (or (>= (offset) 10) (<= (offset) -10)))
    :effect (and (decrease (reward) 100) (unsafe) (terminal))))
