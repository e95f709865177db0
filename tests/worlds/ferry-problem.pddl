; Cargo is to be brought from c to a.
(define (problem p) (:domain ferry)
  (:init (at a) (cargo c) (next a b) (next b a) (next b c) (next c b) (next c d) (next d c))
  (:goal (and (cargo a))))
