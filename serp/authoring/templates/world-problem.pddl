; Where ${name} begins. What is not stated is false.

(define (problem start)
  (:domain ${name})
  (:init
    (= (position) 0)
    (= (battery) 4))
  (:goal (and (carries) (< (position) 0.5))))
