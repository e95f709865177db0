; A robot pushes crates through a warehouse whose floor plan never changes.
(define (domain warehouse)
  (:requirements :strips :typing :equality :negative-preconditions)
  (:types place direction crate)
  (:predicates (beside ?from ?to - place ?towards - direction)
               (robot-at ?where - place)
               (crate-at ?crate - crate ?where - place)
               (empty ?where - place))

  (:action walk
    :parameters (?from ?to - place ?towards - direction)
    :precondition (and (beside ?from ?to ?towards) (robot-at ?from) (empty ?to))
    :effect (and (robot-at ?to) (empty ?from) (not (robot-at ?from)) (not (empty ?to))))

  (:action push
    :parameters (?crate - crate ?from ?middle ?to - place ?towards - direction)
    :precondition (and (beside ?from ?middle ?towards) (beside ?middle ?to ?towards)
                       (not (= ?from ?to))
                       (robot-at ?from) (crate-at ?crate ?middle) (empty ?to))
    :effect (and (robot-at ?middle) (crate-at ?crate ?to) (empty ?from)
                 (not (robot-at ?from)) (not (crate-at ?crate ?middle)) (not (empty ?to)))))
