; The four places of the town, and a passenger to plan for where no environment gives one.

(define (problem town)
  (:domain taxi)
  (:objects red green yellow blue - place)
  (:init
    (= (row-of red) 0) (= (column-of red) 0)
    (= (row-of green) 0) (= (column-of green) 4)
    (= (row-of yellow) 4) (= (column-of yellow) 0)
    (= (row-of blue) 4) (= (column-of blue) 3)
    (= (row) 2) (= (column) 2)
    (waits yellow)
    (wanted blue))
  (:goal (and)))   ; other tools ask for one; what is wanted is in taxi.pddl
