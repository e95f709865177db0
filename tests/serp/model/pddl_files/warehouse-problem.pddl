; An aisle of five places and a niche north of the second one:
;      niche
;   a1  a2   a3   a4   a5
(define (problem aisle)
  (:domain warehouse)
  (:objects a1 a2 a3 a4 a5 niche - place
            north south east west - direction
            box - crate)
  (:init (beside a1 a2 east) (beside a2 a3 east) (beside a3 a4 east) (beside a4 a5 east)
         (beside a2 a1 west) (beside a3 a2 west) (beside a4 a3 west) (beside a5 a4 west)
         (beside a2 niche north) (beside niche a2 south)
         (robot-at niche) (crate-at box a3)
         (empty a1) (empty a2) (empty a4) (empty a5))
  (:goal (and (crate-at box a5) (robot-at a4))))
