; ${name}: a cart on a rail fetches a parcel and brings it home, before its battery is empty.
;
; `serp new` wrote this example. Play it, then change it line by line into your own robot:
;   serp play ${name}.pddl            step it by hand; `?` asks the planner
;   serp check ${name}.pddl           does it still make sense?
;   serp play ${name}.pddl --train    let a learner practise in it
;
; How to read it. PDDL puts everything in parentheses, the operator first: (+ 1 2) is 1 + 2. What
; follows a semicolon is a comment. Where the robot begins is in ${name}-problem.pddl.

(define (domain ${name})
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :time)

  ; What is true or false.
  (:predicates
    (carries)    ; the parcel is on the cart
    (unsafe)     ; reserved: something breaks; avoided as long as anything else is possible
    (terminal))  ; reserved: the episode ends

  ; What has a number.
  (:functions
    (position)   ; metres from home; the parcel lies at 3, the rail ends at 4
    (battery)    ; steps that it lasts
    (reward))    ; reserved: its increase in a step is the reward of the step

  ; What the robot can do: an action is possible if its precondition holds, and its effects are
  ; what it changes.

  (:action forward            ; one metre away from home
    :parameters ()
    :precondition (and)
    :effect (and (increase (position) 1)))

  (:action back               ; one metre towards home
    :parameters ()
    :precondition (and (> (position) 0.5))
    :effect (and (decrease (position) 1)))

  (:action pick-up            ; a good step on the way
    :parameters ()
    :precondition (and (not (carries)) (> (position) 2.5) (< (position) 3.5))
    :effect (and (carries) (increase (reward) 1)))

  (:action charge             ; only at home
    :parameters ()
    :precondition (and (< (position) 0.5))
    :effect (and (assign (battery) 9)))

  ; What the world does by itself, per unit of time: #t is the time that passes.

  (:process use-up            ; one step of the battery per unit of time
    :parameters ()
    :precondition (and)
    :effect (and (decrease (battery) (* #t 1))))

  ; What happens at thresholds. Events are checked after every step.

  (:event time                ; the sooner the better
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) 0.1)))

  (:event delivered
    :parameters ()
    :precondition (and (carries) (< (position) 0.5))
    :effect (and (increase (reward) 10) (terminal)))

  (:event crash               ; the cart falls off the rail
    :parameters ()
    :precondition (and (> (position) 4.5))
    :effect (and (unsafe) (terminal)))

  (:event empty               ; the cart stands still, and somebody has to fetch it
    :parameters ()
    :precondition (and (< (battery) 0.5))
    :effect (and (unsafe) (terminal))))
