; Its states never repeat.
(define (domain endless)
  (:functions (x) (y) (reward))
  (:action a :parameters () :precondition (and)
    :effect (and (increase (x) (+ 1 (* 0.3 (y)))) (increase (reward) (x))))
  (:action b :parameters () :precondition (and)
    :effect (and (increase (y) (+ 1 (* 0.7 (x)))))))
