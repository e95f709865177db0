(define (problem p) (:domain house)
  (:init (at a) (hot b) (= (battery) 9)
    (next a b) (next b d) (next a c) (next c a) (next c d) (next d c))
  (:goal (and (at d) (not (light)))))
