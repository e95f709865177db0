; A delivery robot in the corridor of an office: it loads parcels in the mail room, drives to the rooms to
; which they are addressed, and must not hurt or break anything. Metres; a step is a metre of driving.

(define (domain corridor)
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :conditional-effects
                 :universal-preconditions :time)
  (:types room parcel)

  ; What is true or false.
  (:predicates
    (address ?p - parcel ?r - room)  ; to which room a parcel has to go
    (loaded ?p - parcel)             ; it lies on the robot
    (delivered ?p - parcel)          ; it is where it has to go
    (door-open)                      ; the fire door behind the lab
    (unsafe)
    (terminal))

  ; What has a number.
  (:functions
    (position)         ; metres from the mail room
    (place ?r - room)  ; metres from the mail room to the door of a room
    (person)           ; steps until somebody crosses the corridor, 2 metres from the mail room
    (battery)          ; steps that it lasts
    (reward))

  ; What the robot can do.

  (:action forward  ; a metre away from the mail room
    :parameters ()
    :precondition (and (< (position) 5.5))
    :effect (and
      (increase (position) 1)
      ; the fire door is shut, 4.5 metres from the mail room
      (when (and (> (position) 3.5) (< (position) 4.5) (not (door-open))) (unsafe))
      ; somebody is hit
      (when (and (> (position) 0.5) (< (position) 1.5) (> (person) 0.5) (< (person) 1.5))
        (unsafe))))

  (:action back  ; a metre towards the mail room
    :parameters ()
    :precondition (and (> (position) 0.5))
    :effect (and
      (decrease (position) 1)
      ; somebody is hit
      (when (and (> (position) 2.5) (< (position) 3.5) (> (person) 0.5) (< (person) 1.5))
        (unsafe))))

  (:action wait  ; let somebody pass
    :parameters ()
    :precondition (and)
    :effect (and))

  (:action load  ; in the mail room
    :parameters (?p - parcel)
    :precondition (and (< (position) 0.5) (not (loaded ?p)) (not (delivered ?p)))
    :effect (and (loaded ?p) (increase (reward) 1)))  ; a good step on the way

  (:action hand-over  ; in front of the room on the label
    :parameters (?p - parcel ?r - room)
    :precondition (and
      (loaded ?p)
      (address ?p ?r)
      (> (position) (- (place ?r) 0.5))
      (< (position) (+ (place ?r) 0.5)))
    :effect (and (not (loaded ?p)) (delivered ?p) (increase (reward) 10)))

  (:action open-door  ; from the lab
    :parameters ()
    :precondition (and (> (position) 3.5) (not (door-open)))
    :effect (and (door-open)))

  (:action charge  ; the station is in the mail room
    :parameters ()
    :precondition (and (< (position) 0.5))
    :effect (and (assign (battery) 20)))

  ; What the world does by itself.

  (:process use-up  ; driving or not
    :parameters ()
    :precondition (and)
    :effect (and (decrease (battery) (* #t 1))))

  (:process walk  ; the person comes nearer
    :parameters ()
    :precondition (and)
    :effect (and (decrease (person) (* #t 1))))

  ; What happens at certain points.

  (:event next-person  ; four steps later
    :parameters ()
    :precondition (and (< (person) -0.5))
    :effect (and (assign (person) 4)))

  (:event time  ; the sooner the better
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) 0.1)))

  (:event low  ; it would not get home any more
    :parameters ()
    :precondition (and (< (battery) (+ (position) 1.5)))
    :effect (and (decrease (reward) 3)))

  (:event empty  ; somebody has to fetch the robot: a nuisance, no damage
    :parameters ()
    :precondition (and (< (battery) 0.5))
    :effect (and (decrease (reward) 20) (terminal)))

  (:event all-done  ; every parcel is where it has to go
    :parameters ()
    :precondition (and (forall (?p - parcel) (delivered ?p)))
    :effect (and (terminal))))
