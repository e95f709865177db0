; A village.
(define (problem village) (:domain walk)
  (:objects home shop field - place)
  (:init (at home) (road home shop) (road shop home) (road home field) (mined field)
         (= (walked) 0))
  (:goal (and)))
