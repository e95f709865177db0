; Acrobot: two links hang from an axis, one below the other; a motor in the joint between them has to
; swing the free end up.
;
; Left out: everything but what is wanted. The actions have no effects, there is no process, and
; nothing says that swinging helps.
;
; What it is for: a goal that no step comes nearer to, with four numbers to control and one motor.

(define (domain acrobot)  ; serp: ignore-file[unused-name]
  (:requirements :strips :typing :numeric-fluents :time)

  (:predicates
    (terminal))        ; the episode ends here

  ; The angles themselves would jump at half a turn. Their cosines and sines do not.
  (:functions
    (upper-cosine)     ; of the first link's angle: 1 where it hangs, -1 where it stands
    (upper-sine)
    (lower-cosine)     ; of the second link's angle, from the direction of the first
    (lower-sine)
    (upper-velocity)   ; radians per second
    (lower-velocity)
    (reward))

  ; What the robot can do. Nobody has measured what comes of it.

  (:action turn-left
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action let-go
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action turn-right
    :parameters ()
    :precondition (and)
    :effect (and))

  ; The free end is so far above the axis, in links: -cos(a) - cos(a + b).
  (:event too-low
    :parameters ()
    :precondition (and (<= (- (- (* (upper-sine) (lower-sine))
      (* (upper-cosine) (lower-cosine))) (upper-cosine)) 1))
    :effect (and (decrease (reward) 1)))

  (:event high
    :parameters ()
    :precondition (and (> (- (- (* (upper-sine) (lower-sine))
      (* (upper-cosine) (lower-cosine))) (upper-cosine)) 1))
    :effect (and (terminal))))
