; A robot with two hands carries balls from room to room. What is a room, a ball or a hand is said by
; predicates that nothing changes, as before there were types.
(define (domain gripper)
  (:requirements :strips)
  (:predicates (room ?r) (ball ?b) (gripper ?g)
               (at-robby ?r) (at ?b ?r) (free ?g) (carry ?b ?g))

  (:action move
    :parameters (?from ?to)
    :precondition (and (room ?from) (room ?to) (at-robby ?from))
    :effect (and (at-robby ?to) (not (at-robby ?from))))

  (:action pick
    :parameters (?ball ?room ?hand)
    :precondition (and (ball ?ball) (room ?room) (gripper ?hand)
                       (at ?ball ?room) (at-robby ?room) (free ?hand))
    :effect (and (carry ?ball ?hand) (not (at ?ball ?room)) (not (free ?hand))))

  (:action drop
    :parameters (?ball ?room ?hand)
    :precondition (and (ball ?ball) (room ?room) (gripper ?hand)
                       (carry ?ball ?hand) (at-robby ?room))
    :effect (and (at ?ball ?room) (free ?hand) (not (carry ?ball ?hand)))))
