; Door and key: a robot on a grid fetches a key, opens the locked door in a wall and goes to the goal
; in the lower right corner.
;
; Left out: that the robot could drop the key again, for which there is no reason. Where wall, door
; and key are, the robot sees.

(define (domain door-key)
  (:requirements :strips :typing :disjunctive-preconditions :negative-preconditions
                 :conditional-effects :numeric-fluents :time)

  (:predicates
    (has-key)
    (open)                 ; the door is
    (terminal))            ; the episode ends here

  (:functions
    (x) (y)                ; cells from the upper left corner; 0 and 7 are walls
    (dx) (dy)              ; what lies one cell ahead: 1, 0 is to the right, 0, 1 is down
    (key-x) (key-y)        ; 0, 0 where nothing else can be: the robot has it
    (wall) (door)          ; the wall's x, and the door's y
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
      (> (+ (x) (dx)) 0) (< (+ (x) (dx)) 7) (> (+ (y) (dy)) 0) (< (+ (y) (dy)) 7)
      (or (not (= (+ (x) (dx)) (wall))) (and (open) (= (+ (y) (dy)) (door))))
      (or (not (= (+ (x) (dx)) (key-x))) (not (= (+ (y) (dy)) (key-y)))))
    :effect (and (increase (x) (dx)) (increase (y) (dy))))

  (:action pick-up
    :parameters ()
    :precondition (and (not (has-key)) (= (+ (x) (dx)) (key-x)) (= (+ (y) (dy)) (key-y)))
    :effect (and (has-key) (assign (key-x) 0) (assign (key-y) 0)))

  ; What is open is closed by it.
  (:action toggle
    :parameters ()
    :precondition (and (has-key) (= (+ (x) (dx)) (wall)) (= (+ (y) (dy)) (door)))
    :effect (and (when (not (open)) (open)) (when (open) (not (open)))))

  (:event goal
    :parameters ()
    :precondition (and (= (x) 6) (= (y) 6))
    :effect (and (increase (reward) 1) (terminal))))
