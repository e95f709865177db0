; Swing-up: a pendulum whose motor is too weak to lift it. It has to be swung to and fro until it
; gets over the top, and held there.
;
; Left out: everything about how the pendulum moves. The actions have no effects, and there is no
; process. The expert says what the actions are called and what is wanted, no more.
;
; What it is for: a task that no straight way leads to. With this file alone the planner cannot tell
; one action from another; serp finds out what they do while it acts, and writes it into the
; model. What is said here is what it then plans for.

(define (domain swing-up)  ; serp: ignore-file[unused-name]
  (:requirements :strips :typing :numeric-fluents :time)

  ; The angle itself would jump from one end to the other where the pendulum hangs. Its cosine and
  ; sine do not: they are the place of the mass, up and to the right of the axis.
  (:functions
    (height)    ; metres above the axis, 1 upright and -1 hanging: the cosine of the angle
    (side)      ; metres to the right of the axis: the sine of the angle
    (velocity)  ; radians per second, positive to the right
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

  ; What is good about the place where a step has led. Upright and at rest is worth 0, all else
  ; costs.

  (:event low                 ; from 0 upright to 0.5 hanging
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) (* 0.25 (- 1.0 (height))))))

  ; Height alone does not tell how to begin: who swings has to come down again first. What has to
  ; grow is the energy. Per unit of weight it is the height plus the square of the velocity over
  ; twice the gravity, and 1 is what it takes to stand upright. More is as bad as less: the
  ; pendulum would shoot over the top.
  (:event too-little-swing
    :parameters ()
    :precondition (and (< (+ (height) (/ (* (velocity) (velocity)) 19.6)) 1.0))
    :effect (and (decrease (reward)
      (* 0.5 (- 1.0 (+ (height) (/ (* (velocity) (velocity)) 19.6)))))))

  (:event too-much-swing
    :parameters ()
    :precondition (and (> (+ (height) (/ (* (velocity) (velocity)) 19.6)) 1.0))
    :effect (and (decrease (reward)
      (* 0.5 (- (+ (height) (/ (* (velocity) (velocity)) 19.6)) 1.0))))))
