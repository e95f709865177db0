; The four places of the town.

(define (problem town)
  (:domain taxi)
  (:objects red green yellow blue - place)
  (:init
    (= (row-of red) 0) (= (column-of red) 0)
    (= (row-of green) 0) (= (column-of green) 4)
    (= (row-of yellow) 4) (= (column-of yellow) 0)
    (= (row-of blue) 4) (= (column-of blue) 3)))
