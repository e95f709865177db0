(define (domain van)
  (:types place)
  (:predicates (at ?p - place) (road ?a ?b - place) (unsafe) (terminal))
  (:functions (fuel) (reward))
  (:action drive :parameters (?a ?b - place)   ; along a road
    :precondition (and (at ?a) (road ?a ?b) (> (fuel) 0))
    :effect (and (not (at ?a)) (at ?b) (decrease (fuel) 2)))
  (:process leak :parameters () :precondition () :effect (decrease (fuel) (* #t 1)))
  (:event empty :parameters () :precondition (and (<= (fuel) 0))  ; nobody comes
    :effect (and (assign (fuel) 0) (decrease (reward) 7) (unsafe) (terminal))))