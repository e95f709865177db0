; The morning round: two offices, and a letter for each.

(define (problem morning)
  (:domain delivery)
  (:objects lab archive - office)
  (:init
    (= (robot) 0)
    (= (person) 9)
    (= (battery) 40)
    (= (door lab) 2)
    (= (door archive) 7)
    (carries lab)
    (carries archive))
  (:goal (and)))
