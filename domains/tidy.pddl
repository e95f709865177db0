; A mobile robot clears a table into a drawer and a shelf, in a room where a person walks.
; Left out: how the person walks and blocks ways, how often a grasp slips. Times are guesses.
(define (domain tidy)
  (:requirements :strips :typing :negative-preconditions :disjunctive-preconditions
                 :conditional-effects :universal-preconditions :numeric-fluents)
  (:types place thing - object
          small tall - thing)  ; the small ones belong in the drawer, the tall ones on the shelf
  (:constants table drawer shelf charger - place block can - small bottle glass - tall)
  (:predicates
    (at ?p - place)
    (ahead ?t - thing)     ; the robot stands straight before it
    (on-table ?t - thing)
    (held ?t - thing)
    (tidy ?t - thing)      ; it is where it belongs
    (lost ?t - thing)      ; it fell, and the arm cannot pick it up
    (hit) (spilled)        ; the robot ran into the person, the full glass spilled
    (unsafe)               ; avoided as long as anything else is possible
    (terminal))            ; the episode ends here
  (:functions (battery)    ; 0 to 1
    (opening)              ; of the drawer, metres
    (gap ?p - place)       ; between the person and the straight way there, metres
    (reward))              ; what is tidy is worth 1; a second costs 0.01

  (:action drive
    :parameters (?p - place)
    :precondition (and (not (at ?p)))
    :effect (and (at ?p) (decrease (battery) 0.03) (decrease (reward) 0.06)
      (forall (?q - place) (not (at ?q))) (forall (?t - thing) (not (ahead ?t)))))

  ; Faster, but it stops for nobody, and a full glass spills.
  (:action rush
    :parameters (?p - place)
    :precondition (and (not (at ?p)))
    :effect (and (at ?p) (decrease (battery) 0.05) (decrease (reward) 0.03)
      (forall (?q - place) (not (at ?q))) (forall (?t - thing) (not (ahead ?t)))
      (when (or (held glass) (< (gap ?p) 2)) (unsafe))))

  (:action approach
    :parameters (?t - thing)
    :precondition (and (at table) (on-table ?t) (not (ahead ?t))
      (forall (?o - thing) (not (held ?o))))
    :effect (and (ahead ?t) (decrease (battery) 0.01) (decrease (reward) 0.03)
      (forall (?o - thing) (when (not (= ?o ?t)) (not (ahead ?o))))))

  (:action grasp
    :parameters (?t - thing)
    :precondition (and (ahead ?t) (on-table ?t) (forall (?o - thing) (not (held ?o)))
      (imply (or (= ?t block) (= ?t can)) (> (opening) 0.2)))  ; it takes a free hand to open
    :effect (and (held ?t) (not (on-table ?t)) (decrease (battery) 0.01) (decrease (reward) 0.05)))
  (:action put-back
    :parameters (?t - thing)
    :precondition (and (at table) (held ?t))
    :effect (and (on-table ?t) (not (held ?t)) (decrease (battery) 0.01) (decrease (reward) 0.05)))

  (:action place-in-drawer
    :parameters (?t - small)
    :precondition (and (at drawer) (held ?t) (> (opening) 0.2))
    :effect (and (tidy ?t) (not (held ?t)) (decrease (battery) 0.01) (increase (reward) 0.95)))
  (:action place-on-shelf
    :parameters (?t - tall)
    :precondition (and (at shelf) (held ?t))
    :effect (and (tidy ?t) (not (held ?t)) (decrease (battery) 0.01) (increase (reward) 0.95)))

  (:action open-drawer :parameters ()
    :precondition (and (at drawer) (forall (?o - thing) (not (held ?o))) (< (opening) 0.2))
    :effect (and (assign (opening) 0.35) (decrease (battery) 0.01) (decrease (reward) 0.06)))
  (:action close-drawer :parameters ()
    :precondition (and (at drawer) (forall (?o - thing) (not (held ?o))) (> (opening) 0.03))
    :effect (and (assign (opening) 0) (decrease (battery) 0.01) (decrease (reward) 0.06)))
  (:action charge :parameters () :precondition (and (at charger) (< (battery) 0.9))
    :effect (and (assign (battery) 1) (decrease (reward) 0.08)))
  (:action wait :parameters () :effect (and (decrease (reward) 0.01)))

  ; What is still to do costs a little in every step, so that the planner sees a reason to begin.
  (:event untidy
    :parameters (?t - thing)
    :precondition (and (on-table ?t))
    :effect (and (decrease (reward) 0.3)))
  (:event shut
    :parameters (?t - small)
    :precondition (and (on-table ?t) (< (opening) 0.2))
    :effect (and (decrease (reward) 0.2)))
  (:event all-tidy :parameters ()
    :precondition (and (< (opening) 0.04) (forall (?t - thing) (or (tidy ?t) (lost ?t))))
    :effect (and (increase (reward) 1) (terminal)))
  (:event low :parameters () :precondition (and (< (battery) 0.25))  ; time to charge
    :effect (and (decrease (reward) (* 4 (- 0.25 (battery))))))
  (:event damage :parameters () :precondition (and (or (hit) (spilled) (<= (battery) 0)))
    :effect (and (decrease (reward) 100) (unsafe) (terminal))))
