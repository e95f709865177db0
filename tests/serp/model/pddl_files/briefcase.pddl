; ADL: whatever is in the briefcase travels with it.
(define (domain briefcase)
  (:requirements :adl)
  (:types portable location)
  (:predicates (at ?what - portable ?where - location) (in ?what - portable)
               (is-at ?where - location))

  (:action move
    :parameters (?from ?to - location)
    :precondition (and (is-at ?from) (not (= ?from ?to)))
    :effect (and (is-at ?to) (not (is-at ?from))
                 (forall (?what - portable)
                   (when (in ?what)
                     (and (at ?what ?to) (not (at ?what ?from)))))))

  (:action put-in
    :parameters (?what - portable ?where - location)
    :precondition (and (is-at ?where) (at ?what ?where) (not (in ?what)))
    :effect (and (in ?what)))

  (:action take-out
    :parameters (?what - portable)
    :precondition (and (in ?what))
    :effect (and (not (in ?what)))))
