; Delivery: a delivery robot brings letters from the mail room to offices along a corridor, while a
; person walks through it towards the mail room.
;
; Units: metres from the mail room, seconds. A step takes one second.

(define (domain delivery)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions
                 :numeric-fluents :time)

  (:types office)

  (:predicates
    (carries ?o - office)    ; a letter for this office is on the robot
    (aside)                  ; the robot stands in the niche, out of the way
    (unsafe)
    (terminal))

  (:functions
    (robot)                  ; where the robot is
    (person)                 ; where the person is; behind the mail room it is out of sight
    (battery)                ; seconds that it lasts
    (door ?o - office)       ; where the office is
    (reward))

  (:action forward
    :parameters ()
    :precondition (and (< (robot) 9.5) (not (aside)))
    :effect (and (increase (robot) 1)))

  (:action back
    :parameters ()
    :precondition (and (> (robot) 0.5) (not (aside)))
    :effect (and (decrease (robot) 1)))

  (:action step-aside        ; the niche is at 4 metres
    :parameters ()
    :precondition (and (not (aside)) (> (robot) 3.5) (< (robot) 4.5))
    :effect (and (aside)))

  (:action step-out
    :parameters ()
    :precondition (and (aside))
    :effect (and (not (aside))))

  (:action wait
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action charge            ; only in the mail room
    :parameters ()
    :precondition (and (< (robot) 0.5))
    :effect (and (assign (battery) 60)))

  (:action hand-over         ; within half a metre of the door
    :parameters (?o - office)
    :precondition (and (carries ?o) (not (aside))
      (> (robot) (- (door ?o) 0.5)) (< (robot) (+ (door ?o) 0.5)))
    :effect (and (not (carries ?o)) (increase (reward) 10)))

  (:process walk             ; the person walks on, whatever the robot does
    :parameters ()
    :precondition (and (> (person) -2))
    :effect (and (decrease (person) (* #t 0.5))))

  (:process use-up           ; the battery empties
    :parameters ()
    :precondition (and)
    :effect (and (decrease (battery) (* #t 1))))

  (:event late               ; every letter waits, the more the farther its office
    :parameters (?o - office)
    :precondition (and (carries ?o) (< (robot) (door ?o)))
    :effect (and (decrease (reward) (* 0.1 (- (door ?o) (robot))))))

  (:event late-behind        ; the same for offices that the robot has passed
    :parameters (?o - office)
    :precondition (and (carries ?o) (> (robot) (door ?o)))
    :effect (and (decrease (reward) (* 0.1 (- (robot) (door ?o))))))

  (:event collision          ; closer than a metre to the person, in the corridor
    :parameters ()
    :precondition (and (not (aside)) (> (robot) 0.5)
      (< (- (person) (robot)) 1) (> (- (person) (robot)) -1))
    :effect (and (unsafe) (terminal)))

  (:event empty              ; it stands in the way until somebody comes
    :parameters ()
    :precondition (and (< (battery) 1))
    :effect (and (unsafe) (terminal)))

  (:event done               ; all letters are delivered
    :parameters ()
    :precondition (and (forall (?o - office) (not (carries ?o))))
    :effect (and (terminal))))
