; ${name}: what is known of ${env}.
;
; `serp new` made this frame of what the environment tells of itself. What is left to do is yours:
; say what the actions change, what is good, and what must never happen. It need not be exact, and
; not all of it is needed: what the file leaves out, SErP learns while it acts.
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

  ; What is true or false. Both names are reserved. Where an event makes one of them true:
  (:predicates
    (unsafe)     ; something breaks: avoided as long as anything else is possible
    (terminal))  ; the episode ends

  ; What has a number. ${name}.py says where each comes from; rename or remove them in both files.
  (:functions
${functions}

  ; What the robot can do. An effect says what changes, such as
  ;   :effect (and (increase (${first}) 0.1))
  ; and a precondition when it can be done, such as (and (< (${first}) 1)).

${schemas}
  ; What the world does by itself, per unit of time. Remove the semicolons:

  ; (:process drift
  ;   :parameters ()
  ;   :precondition (and)
  ;   :effect (and (increase (${first}) (* #t 0.1))))

  ; What is good or bad about the place where a step has led. Without a reward in this file, the
  ; learner learns from that of the environment, and the planner has nothing to go by. With one, the
  ; learner learns from this file's alone, unless ${name}.py says serp.Task(reward="environment").

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
