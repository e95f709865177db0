; Cliff: a robot on an icy plateau of four rows and twelve columns. Start and goal lie at the two ends
; of the lowest row, and all between them is a cliff.
;
; Left out: that the ground is slippery. The robot often goes to the left or to the right of where it
; meant to go; this file says that it goes where it means to.
;
; What it is for: a plan that is the shortest and looks safe, and leads along the edge. serp
; finds out from what it sees how often a move goes astray, and keeps away from the cliff.

(define (domain cliff)
  (:requirements :strips :typing :conditional-effects :numeric-fluents :time)

  (:predicates
    (unsafe)     ; avoided as long as anything else is possible
    (terminal))  ; the episode ends here

  (:functions
    (row)        ; 0 is the highest, 3 the lowest
    (column)     ; 0 on the left, 11 on the right
    (reward))

  ; What the robot means to do. At the rim of the plateau a wall stops it.

  (:action up
    :parameters ()
    :precondition (and)
    :effect (and (when (> (row) 0) (decrease (row) 1))))

  (:action right
    :parameters ()
    :precondition (and)
    :effect (and (when (< (column) 11) (increase (column) 1))))

  (:action down
    :parameters ()
    :precondition (and)
    :effect (and (when (< (row) 3) (increase (row) 1))))

  (:action left
    :parameters ()
    :precondition (and)
    :effect (and (when (> (column) 0) (decrease (column) 1))))

  ; Every step has a cost that grows with the distance from the goal. So five steps of lookahead
  ; are enough to see the direction of the goal.
  (:event distance
    :parameters ()
    :precondition (and)
    :effect (and (decrease (reward) (* 0.1 (+ (- 3 (row)) (- 11 (column)))))))

  ; A fall costs more than all the steps that it saves.
  (:event fall
    :parameters ()
    :precondition (and (= (row) 3) (> (column) 0) (< (column) 11))
    :effect (and (decrease (reward) 30.0) (unsafe) (terminal)))

  (:event goal
    :parameters ()
    :precondition (and (= (row) 3) (= (column) 11))
    :effect (and (terminal))))
