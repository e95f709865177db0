; Four rooms: a robot on a grid of 19 by 19 cells goes to a goal, through gaps in the walls between
; four rooms.
;
; Left out: nothing. Where the gaps and the goal are, the robot sees.

(define (domain four-rooms)
  (:requirements :strips :typing :disjunctive-preconditions :negative-preconditions
                 :numeric-fluents :time)

  (:predicates
    (terminal))                    ; the episode ends here

  (:functions
    (x) (y)                        ; cells from the upper left corner; 0, 9 and 18 are walls
    (dx) (dy)                      ; what lies one cell ahead: 1, 0 is to the right, 0, 1 is down
    (goal-x) (goal-y)
    (gap-above) (gap-below)        ; y of the gaps in the vertical wall, x = 9
    (gap-left) (gap-right)         ; x of the gaps in the horizontal wall, y = 9
    (reward))

  (:action left
    :parameters ()
    :precondition (and)
    :effect (and (assign (dx) (dy)) (assign (dy) (- 0 (dx)))))

  (:action right
    :parameters ()
    :precondition (and)
    :effect (and (assign (dx) (- 0 (dy))) (assign (dy) (dx))))

  (:action forward
    :parameters ()
    :precondition (and
      (> (+ (x) (dx)) 0) (< (+ (x) (dx)) 18) (> (+ (y) (dy)) 0) (< (+ (y) (dy)) 18)
      (or (not (= (+ (x) (dx)) 9)) (= (+ (y) (dy)) (gap-above)) (= (+ (y) (dy)) (gap-below)))
      (or (not (= (+ (y) (dy)) 9)) (= (+ (x) (dx)) (gap-left)) (= (+ (x) (dx)) (gap-right))))
    :effect (and (increase (x) (dx)) (increase (y) (dy))))

  (:event goal
    :parameters ()
    :precondition (and (= (x) (goal-x)) (= (y) (goal-y)))
    :effect (and (increase (reward) 1) (terminal))))
