; Corner kick: keep the other team's corner out of our goal.
;
; This file is all that serp knows about the task; if PDDL is new to you, begin with cartpole.pddl.
; After an edit, `serp check domains/corner-kick.pddl` tells whether it still makes sense, and
; `serp plan --domain corner-kick` what the planner would do. Units: metres, seconds, radians.
;
; What a coach tells a defender: stay with your opponent until the corner is taken. Then it is a
; race: run to where the ball will be and kick it away, or close the goal if you come too late.

(define (domain corner-kick)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :conditional-effects :numeric-fluents :time)

  ; The posts are not two objects of one type: the ball comes from the side of the near one, so
  ; what holds of one does not hold of the other.
  (:predicates
    (taken)              ; the corner has been taken, the ball is in play
    (kicked)             ; the robot kicks the ball right now
    (unsafe)             ; "this damages a robot": avoided as long as anything else is possible
    (terminal))          ; the corner is over

  (:functions
    (robot-to-ball)      ; from middle to middle, m
    (ball-in)            ; seconds until the robot has the ball, if it goes to meet it; 0 in reach
    (shot-in)            ; seconds until the opponent can shoot, if nobody stops it
    (robot-to-mark)      ; to the place between opponent and goal, an arm's length from it, m
    (robot-to-opponent)  ; 0.30 when they touch, m
    (off-line)           ; angle at the ball between the robot and the middle of the goal, 0 to pi
    (goal-open)          ; share of the goal that the robot leaves open to a shot, 0 to 1
    (reward))

  ; What the robot can do. An action lasts 0.4 s, in which a robot walks 0.10 m (0.25 m/s).
  ; Between actions that promise the same, serp takes the first in this file.

  (:action intercept           ; go to where the rolling ball can be met
    :parameters ()
    :precondition (and)
    :effect (and (decrease (ball-in) 0.4) (increase (robot-to-mark) 0.10)))

  (:action clear               ; walk to where the ball is now, and kick it away when it is in reach
    :parameters ()
    :precondition (and)
    :effect (and
      (increase (robot-to-mark) 0.10)
      (when (and (<= (robot-to-ball) 0.5)) (decrease (ball-in) 0.4))
      (when (and (> (robot-to-ball) 0.5)) (decrease (ball-in) 0.2))  ; it rolls on meanwhile
      (when (and (< (ball-in) 0.1)) (kicked))))

  (:action mark-attacker       ; stand between the opponent and the goal
    :parameters ()
    :precondition (and)
    :effect (and
      (decrease (robot-to-mark) 0.08)  ; sideways, the face to the ball: 0.20 m/s
      (when (and (> (off-line) 1.6)) (decrease (off-line) 0.2))  ; back towards the goal
      ; Only with the opponent at the ball, or nearly, does closing its way close the goal.
      (when (and (taken) (< (shot-in) 3.0)) (decrease (goal-open) 0.15))))

  ; Marking a post helps only if the ball goes there. Before the kick nobody knows that. So
  ; the file has no opinion on the posts, and the planner leaves them: the learner finds out.
  (:action mark-near-post
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action mark-far-post
    :parameters ()
    :precondition (and)
    :effect (and))

  ; Running into the opponent is forbidden wherever it stands: the run gains nothing but the
  ; collision, and nobody can tell when the two will meet. So the action itself is unsafe.
  (:action charge-opponent
    :parameters ()
    :precondition (and)
    :effect (and
      (unsafe)
      (decrease (robot-to-opponent) 0.14)
      (when (and (< (robot-to-opponent) 0.40)) (decrease (reward) 10.0))))  ; one of them falls

  ; What the world does by itself: the opponent runs to the ball, turns and winds up for a shot.

  (:process opponent-gets-ready
    :parameters ()
    :precondition (and (> (shot-in) 0.0))
    :effect (and (decrease (shot-in) (* #t 1.0))))

  ; What happens at certain points, looked at after every step. First, what ends a movement.

  (:event robot-has-the-ball
    :parameters ()
    :precondition (and (< (ball-in) 0.0))
    :effect (and (assign (ball-in) 0.0)))

  (:event robot-marks
    :parameters ()
    :precondition (and (< (robot-to-mark) 0.0))
    :effect (and (assign (robot-to-mark) 0.0)))

  (:event on-the-line
    :parameters ()
    :precondition (and (< (off-line) 0.0))
    :effect (and (assign (off-line) 0.0)))

  (:event goal-closed
    :parameters ()
    :precondition (and (< (goal-open) 0.0))
    :effect (and (assign (goal-open) 0.0)))

  ; Then, what it is worth. The rewards are those of the rules: 10 for a ball kicked away, -2 for
  ; one that goes out, -10 for a goal against us.

  (:event kick-clears          ; from the goal's side of the ball
    :parameters ()
    :precondition (and (kicked) (< (off-line) 1.6))
    :effect (and (increase (reward) 10.0) (not (kicked)) (terminal)))

  (:event kick-goes-out        ; from the wrong side
    :parameters ()
    :precondition (and (kicked) (>= (off-line) 1.6))
    :effect (and (decrease (reward) 2.0) (not (kicked)) (terminal)))

  (:event opponent-shoots      ; it needs a third of the goal
    :parameters ()
    :precondition (and (not (terminal)) (taken) (< (shot-in) 0.1) (> (goal-open) 0.35))
    :effect (and (decrease (reward) 10.0) (terminal)))

  ; Nobody knows where the corner will go, but the opponent waits where it is wanted: whoever
  ; leaves it alone pays a little all the time.
  (:event opponent-left-alone
    :parameters ()
    :precondition (and (not (taken)) (> (robot-to-mark) 0.2))
    :effect (and (decrease (reward) 0.1))))
