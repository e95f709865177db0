; Which cups there are, what they hold, and how it begins.
(define (problem tea-problem)
  (:domain tea)
  (:objects red blue - cup)
  (:init
    (= (temperature) 60.0)
    (= (water) 0.8)
    (= (size red) 0.2)
    (= (size blue) 0.3))
  (:goal (and)))
