; Carts that are pushed, loaded and stopped, and roll.
(define (domain carts)
  (:requirements :typing :numeric-fluents :time :conditional-effects)
  (:types cart)
  (:constants a b - cart)
  (:predicates (loaded ?c - cart) (unsafe))
  (:functions (x ?c - cart) (v ?c - cart) (heat) (reward))
  (:action push
    :parameters (?c - cart)
    :precondition (and)
    :effect (and (increase (v ?c) 0.5)
                 (when (and (loaded ?c)) (decrease (v ?c) 0.2))
                 (increase (heat) (* 0.1 (* 3.0 (v ?c))))
                 (decrease (reward) 0.25)))
  (:action stop
    :parameters (?c - cart)
    :precondition (and (> (v ?c) -8.0))
    :effect (and (assign (v ?c) 0.125)))
  (:process roll
    :parameters (?c - cart)
    :precondition (and (< (x ?c) 9.0))
    :effect (and (increase (x ?c) (* #t (* 1.0 (v ?c)))) (decrease (heat) (* #t 0.05))))
  (:event wall
    :parameters (?c - cart)
    :precondition (and (> (x ?c) 1.5))
    :effect (and (assign (x ?c) 1.5) (unsafe))))
