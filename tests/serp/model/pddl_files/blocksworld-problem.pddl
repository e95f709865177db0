; Sussman's anomaly: C lies on A, and A is to come on B on C.
(define (problem sussman)
  (:domain blocksworld)
  (:objects a b c)
  (:init (on-table a) (on-table b) (on c a) (clear b) (clear c) (arm-empty))
  (:goal (and (on a b) (on b c))))
