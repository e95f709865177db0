; At the ball: get it past the opponent.
(define (domain contest)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :conditional-effects :numeric-fluents :time)
  (:types side)
  (:constants left right - side)
  (:predicates (free ?s - side) (lined) (in-range) (pushed ?s - side) (terminal))
  (:functions (robot-to-ball) (opponent-to-ball) (goal-open) (reward))

  (:action side-advance :parameters (?s - side) :precondition (and)
    :effect (and
      (decrease (robot-to-ball) 0.10)
      (when (and (< (robot-to-ball) 0.27)) (pushed ?s))))
  (:action frontal-contrast :parameters () :precondition (and)
    :effect (and (decrease (robot-to-ball) 0.10)))
  (:action cover-goal :parameters () :precondition (and)
    :effect (and
      (decrease (goal-open) 0.3)
      (increase (robot-to-ball) 0.06)))

  (:process opponent-approaches :parameters () :precondition (and (> (opponent-to-ball) 0.20))
    :effect (and (decrease (opponent-to-ball) (* #t 0.25))))
  (:event robot-touches :parameters () :precondition (and (< (robot-to-ball) 0.20))
    :effect (and (assign (robot-to-ball) 0.20)))
  (:event goal-closed :parameters () :precondition (and (< (goal-open) 0.0))
    :effect (and (assign (goal-open) 0.0)))

  (:event push-wins :parameters (?s - side) :precondition (and (pushed ?s) (free ?s))
    :effect (and (increase (reward) 10.0) (not (pushed ?s)) (terminal)))
  (:event push-fails :parameters (?s - side) :precondition (and (pushed ?s) (not (free ?s)))
    :effect (and (decrease (reward) 4.0) (not (pushed ?s)) (terminal)))
  (:event opponent-shoots :parameters ()
    :precondition (and (not (terminal)) (in-range) (> (goal-open) 0.35) (< (opponent-to-ball) 0.30)
                       (or (not (lined)) (> (robot-to-ball) 0.27)))
    :effect (and (decrease (reward) 10.0) (terminal)))
  (:event lost :parameters () :precondition (and (not (terminal)) (> (robot-to-ball) 0.5))
    :effect (and (decrease (reward) 2.0) (terminal))))
