; Soccer: defend the goal against an opponent who comes with the ball.
;
; This file is all that serp knows about the task; if PDDL is new to you, begin with cartpole.pddl.
; After an edit, `serp check domains/soccer.pddl` tells whether it still makes sense, and
; `serp plan --domain soccer` what the planner would do. Units: metres, seconds, radians.
;
; A coach could have written it: how fast these robots walk, how far they reach, what usually comes
; of an action. It is rough on purpose. When a push fails after all, the learner finds out.

(define (domain soccer)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :conditional-effects :numeric-fluents :time)

  ; Whatever holds of one side holds of the other, so both are objects and every rule below is
  ; written once.
  (:types side)
  (:constants left right - side)

  (:predicates
    (free ?s - side)     ; a ball pushed to this side gets past the opponent
    (lined)              ; robot, ball and opponent stand in a line
    (in-range)           ; the goal is near enough for a shot: less than 3 m from the ball
    (pushed ?s - side)   ; the robot pushes the ball to this side right now
    (unsafe)             ; "this damages a robot": avoided as long as anything else is possible
    (terminal))          ; the contest is over

  (:functions
    (robot-to-ball)      ; from middle to middle: 0.20 when they touch, up to 0.27 it can kick
    (opponent-to-ball)   ; the same
    (robot-to-opponent)  ; 0.30 when they touch
    (off-line)           ; angle by which the robot is off the line from the ball to the goal
    (goal-open)          ; share of the goal that the robot leaves open to a shot, 0 to 1
    (reward))

  ; What the robot can do. An action lasts 0.4 s, in which a robot walks 0.10 m (0.25 m/s).
  ; Between actions that promise the same, serp takes the first in this file.

  (:action cover-goal          ; step onto the line from the ball to the goal, and stay there
    :parameters ()
    :precondition (and)
    :effect (and
      (decrease (off-line) 0.2)  ; 0.08 m to the side, 0.4 m from the ball
      (when (and (> (off-line) 0.0)) (decrease (goal-open) 0.3))  ; the goal looks 0.7 rad wide
      (when (and (> (robot-to-ball) 0.42)) (decrease (robot-to-ball) 0.10))
      (when (and (< (robot-to-ball) 0.42)) (increase (robot-to-ball) 0.06))))  ; backwards 0.15 m/s

  (:action frontal-contrast    ; walk into the ball and keep the body against it
    :parameters ()
    :precondition (and)
    :effect (and (decrease (robot-to-ball) 0.10)))

  (:action side-advance        ; walk to the ball and push it past the opponent once it is in reach
    :parameters (?s - side)
    :precondition (and)
    :effect (and
      (decrease (robot-to-ball) 0.10)
      (when (and (< (robot-to-ball) 0.27)) (pushed ?s))))

  ; Running into the opponent is forbidden wherever it stands: the run gains nothing but the
  ; collision, and nobody can tell when the two will meet. So the action itself is unsafe.
  (:action charge-opponent
    :parameters ()
    :precondition (and)
    :effect (and
      (unsafe)
      (decrease (robot-to-opponent) 0.14)
      (when (and (< (robot-to-opponent) 0.40)) (decrease (reward) 10.0))))  ; one of them falls

  ; What the world does by itself, all the time: so much per second.

  (:process opponent-approaches
    :parameters ()
    :precondition (and (> (opponent-to-ball) 0.20))
    :effect (and (decrease (opponent-to-ball) (* #t 0.25))))

  ; What happens at certain points, looked at after every step. First, what ends a movement.

  (:event robot-touches
    :parameters ()
    :precondition (and (< (robot-to-ball) 0.20))
    :effect (and (assign (robot-to-ball) 0.20)))

  (:event opponent-touches
    :parameters ()
    :precondition (and (< (opponent-to-ball) 0.20))
    :effect (and (assign (opponent-to-ball) 0.20)))

  (:event on-the-line
    :parameters ()
    :precondition (and (< (off-line) 0.0))
    :effect (and (assign (off-line) 0.0)))

  (:event goal-closed
    :parameters ()
    :precondition (and (< (goal-open) 0.0))
    :effect (and (assign (goal-open) 0.0)))

  ; Then, how the contest ends. The rewards are those of the rules: 10 for the ball, -10 for a goal
  ; against us, -4 for losing the ball. Being close earns nothing, or the robot would stay close.

  (:event push-wins
    :parameters (?s - side)
    :precondition (and (pushed ?s) (free ?s))
    :effect (and (increase (reward) 10.0) (not (pushed ?s)) (terminal)))

  (:event push-fails
    :parameters (?s - side)
    :precondition (and (pushed ?s) (not (free ?s)))
    :effect (and (decrease (reward) 4.0) (not (pushed ?s)) (terminal)))

  (:event alone-with-the-ball  ; the opponent is too far away to fight for it
    :parameters ()
    :precondition (and (not (terminal)) (< (robot-to-ball) 0.27) (> (opponent-to-ball) 0.5))
    :effect (and (increase (reward) 10.0) (terminal)))

  (:event opponent-shoots      ; it needs a third of the goal, and a ball not stuck between the two
    :parameters ()
    :precondition (and (not (terminal)) (in-range) (> (goal-open) 0.35) (< (opponent-to-ball) 0.30)
                       (or (not (lined)) (> (robot-to-ball) 0.27)))
    :effect (and (decrease (reward) 10.0) (terminal))))
