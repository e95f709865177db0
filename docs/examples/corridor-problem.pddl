(define (problem monday)
  (:domain corridor)
  (:objects
    mail-room kitchen lab office - room
    letter box - parcel)
  (:init
    (= (position) 0)
    (= (battery) 12)
    (= (person) 3)
    (= (place mail-room) 0)
    (= (place kitchen) 2)
    (= (place lab) 4)
    (= (place office) 6)
    (address letter lab)
    (address box office)))
