; The whole task: its actions are the sub-tasks, and their effects what comes of these.
(define (domain defence)
  (:requirements :strips :typing :conditional-effects :numeric-fluents :time)
  (:types side)
  (:constants left right - side)
  (:predicates (free ?s - side) (pushed ?s - side) (terminal))
  (:functions (robot-to-ball) (reward))

  (:action approach :parameters () :precondition (and (>= (robot-to-ball) 0.27))
    :effect (and (assign (robot-to-ball) 0.25)))
  (:action contest :parameters () :precondition (and (< (robot-to-ball) 0.6))
    :effect (and (forall (?s - side) (when (and (free ?s)) (pushed ?s)))))

  (:event wins :parameters (?s - side) :precondition (and (pushed ?s))
    :effect (and (increase (reward) 5.0) (not (pushed ?s)) (terminal)))
  (:event time :parameters () :precondition (and)
    :effect (and (decrease (reward) 1.0))))
