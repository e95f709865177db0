; Counters are turned up and down, by a step that each of them sets for itself, at a cost.
(define (domain counters)
  (:requirements :typing :numeric-fluents)
  (:types counter)
  (:functions (value ?c - counter) (step ?c - counter) (limit) (total-cost))

  (:action turn-up
    :parameters (?c - counter)
    :precondition (and (<= (+ (value ?c) (step ?c)) (limit)))
    :effect (and (increase (value ?c) (step ?c)) (increase (total-cost) 1)))

  (:action turn-down
    :parameters (?c - counter)
    :precondition (and (>= (- (value ?c) (step ?c)) 0))
    :effect (and (decrease (value ?c) (step ?c)) (increase (total-cost) 1)))

  (:action double-step
    :parameters (?c - counter)
    :precondition (and (<= (step ?c) 4))
    :effect (and (assign (step ?c) (* 2 (step ?c))) (increase (total-cost) 0.25))))
