; A pendulum whose motor is too weak to lift it at once: swing it up, let it rise, hold it on top.
; Each action is a controller, and its effect is where that leads.
(define (domain pendulum)
  (:requirements :strips :numeric-fluents :time)
  (:functions
    (energy)    ; 1/s²; -30 at rest below, 0 at rest on top
    (lean)      ; angle from the vertical, rad, 0 ... pi
    (reward))

  (:action pump :parameters () :precondition (and (< (energy) -1))
    :effect (and (increase (energy) 5)))
  (:action brake :parameters () :precondition (and (> (energy) 1))
    :effect (and (decrease (energy) 5)))
  (:action coast :parameters () :precondition (and (>= (energy) -1) (<= (energy) 1))
    :effect (and (assign (lean) 0.2)))
  (:action balance :parameters ()
    :precondition (and (<= (lean) 0.4) (>= (energy) -3) (<= (energy) 3))
    :effect (and (assign (lean) 0) (assign (energy) 0)))

  (:event leaning :parameters () :precondition (and)
    :effect (and (decrease (reward) (lean)))))
