; Get to the ball without leaving the goal open.
(define (domain approach)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :conditional-effects :numeric-fluents :time)
  (:predicates (lined) (in-range) (terminal))
  (:functions (robot-to-ball) (opponent-to-ball) (off-line) (goal-open) (reward))

  (:action cover-goal :parameters () :precondition (and)
    :effect (and
      (decrease (off-line) 0.2)
      (when (and (> (off-line) 0.0)) (decrease (goal-open) 0.3))
      (when (and (> (robot-to-ball) 0.42)) (decrease (robot-to-ball) 0.10))
      (when (and (< (robot-to-ball) 0.42)) (increase (robot-to-ball) 0.06))))
  (:action frontal-contrast :parameters () :precondition (and)
    :effect (and (decrease (robot-to-ball) 0.10)))

  (:process opponent-approaches :parameters () :precondition (and (> (opponent-to-ball) 0.20))
    :effect (and (decrease (opponent-to-ball) (* #t 0.25))))
  (:event on-the-line :parameters () :precondition (and (< (off-line) 0.0))
    :effect (and (assign (off-line) 0.0)))
  (:event goal-closed :parameters () :precondition (and (< (goal-open) 0.0))
    :effect (and (assign (goal-open) 0.0)))

  (:event opponent-shoots :parameters ()
    :precondition (and (in-range) (> (goal-open) 0.35) (< (opponent-to-ball) 0.30)
                       (or (not (lined)) (> (robot-to-ball) 0.27)))
    :effect (and (decrease (reward) 10.0) (terminal)))
  (:event there :parameters () :precondition (and (not (terminal)) (< (robot-to-ball) 0.27))
    :effect (and (increase (reward) 5.0) (terminal)))
  (:event time :parameters () :precondition (and)
    :effect (and (decrease (reward) (+ 0.1 (* 0.5 (goal-open)))))))
