; A van brings items to where the goal says, one at a time.
(define (domain delivery)
  (:requirements :typing)
  (:types cell item direction)
  (:constants north south west east - direction)
  (:predicates (van ?c - cell) (at ?i - item ?c - cell) (in ?i - item) (empty)
               (next ?a ?b - cell ?d - direction))
  (:action drive
    :parameters (?from ?to - cell ?d - direction)
    :precondition (and (van ?from) (next ?from ?to ?d))
    :effect (and (not (van ?from)) (van ?to)))
  (:action load
    :parameters (?i - item ?c - cell)
    :precondition (and (van ?c) (at ?i ?c) (empty))
    :effect (and (not (at ?i ?c)) (in ?i) (not (empty))))
  (:action unload
    :parameters (?i - item ?c - cell)
    :precondition (and (van ?c) (in ?i))
    :effect (and (at ?i ?c) (not (in ?i)) (empty))))
