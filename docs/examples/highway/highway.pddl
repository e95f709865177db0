; A car on a motorway of three lanes among slower cars.
(define (domain highway)
  (:requirements :strips :typing :conditional-effects :numeric-fluents :time)
  (:types lane)
  (:constants left middle right - lane)
  (:predicates (unsafe))
  (:functions
    (speed)                 ; m/s
    (our-lane)              ; 0 left, 1 middle, 2 right
    (gap ?l - lane)         ; to the next car ahead or beside in a lane, m
    (closing ?l - lane)     ; how fast that gap gets smaller, m/s
    (reward))

  (:action lane-left :parameters () :precondition (and (> (our-lane) 0))
    :effect (and (decrease (our-lane) 1)))
  (:action idle :parameters () :precondition (and) :effect (and))
  (:action lane-right :parameters () :precondition (and (< (our-lane) 2))
    :effect (and (increase (our-lane) 1)))
  (:action faster :parameters () :precondition (and (< (speed) 28))
    :effect (and (increase (speed) 5)
      (forall (?l - lane) (increase (closing ?l) 5))))
  (:action slower :parameters () :precondition (and (> (speed) 22))
    :effect (and (decrease (speed) 5)
      (forall (?l - lane) (decrease (closing ?l) 5))))

  (:process traffic :parameters (?l - lane) :precondition (and)
    :effect (and (decrease (gap ?l) (* #t (closing ?l)))))

  (:event too-close-left :parameters ()
    :precondition (and (= (our-lane) 0) (< (gap left) (+ 8 (closing left))))
    :effect (and (unsafe)))
  (:event too-close-middle :parameters ()
    :precondition (and (= (our-lane) 1) (< (gap middle) (+ 8 (closing middle))))
    :effect (and (unsafe)))
  (:event too-close-right :parameters ()
    :precondition (and (= (our-lane) 2) (< (gap right) (+ 8 (closing right))))
    :effect (and (unsafe)))
  (:event fast :parameters () :precondition (and)
    :effect (and (increase (reward) (/ (- (speed) 20) 10)))))
