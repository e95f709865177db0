; ${name}: a description of ${env}.
;
; `serp new` wrote the names that the environment gives. Add what you know: what the actions change,
; what is good, and what must never happen. The file need not be exact or complete: SErP learns what
; is missing while it acts.
;
; After a change:
;   serp check ${name}.pddl --task ${name}.py    does it fit together?
;   serp plan --task ${name}.py --observe        what would the planner do?
;   serp plan-and-learn --task ${name}.py        train
;
; How to read it. PDDL puts everything in parentheses, the operator first: (+ 1 2) is 1 + 2. What
; follows a semicolon is a comment.

(define (domain ${name})
  (:requirements :strips :typing :negative-preconditions :numeric-fluents :time)

  ; What is true or false. Both names are reserved. If an event makes one of them true:
  (:predicates
    (unsafe)     ; something breaks: avoided as long as anything else is possible
    (terminal))  ; the episode ends

  ; What has a number. ${name}.py computes each number; rename or remove it in both files.
  (:functions
${functions}

  ; What the robot can do. An effect says what an action changes, such as
  ;   :effect (and (increase (${first}) 0.1))
  ; A precondition says when the action is possible, such as (and (< (${first}) 1)).

${schemas}
  ; What the world does by itself, per unit of time. Remove the semicolons:

  ; (:process drift
  ;   :parameters ()
  ;   :precondition (and)
  ;   :effect (and (increase (${first}) (* #t 0.1))))

  ; Rewards for the state that a step has reached. If this file gives no reward, the learner uses
  ; the environment's reward, and the planner has no aim. If it gives one, the learner uses only
  ; this file's, unless ${name}.py says serp.Task(reward="environment").

  ; (:event good
  ;   :parameters ()
  ;   :precondition (and (> (${first}) 0))
  ;   :effect (and (increase (reward) 1)))

  ; What must not happen.
  ; (:event broken
  ;   :parameters ()
  ;   :precondition (and (> (${first}) 1))
  ;   :effect (and (unsafe) (terminal)))
  )
