(define (domain walk)
  (:requirements :typing :numeric-fluents :negative-preconditions :conditional-effects)
  (:types place)
  (:predicates (at ?p - place) (road ?a - place ?b - place) (mined ?p - place) (unsafe))
  (:functions (walked) (reward))
  (:action go
    :parameters (?a - place ?b - place)
    :precondition (and (at ?a) (road ?a ?b))
    :effect (and (not (at ?a)) (at ?b) (increase (walked) 1) (decrease (reward) 1)
                 (when (mined ?b) (and (unsafe)))))
  (:action rest
    :parameters ()
    :precondition (and (> (walked) 0))
    :effect (and (assign (walked) 0) (increase (reward) 3))))
