; The world of blocks with four operators: STRIPS, no types.
(define (domain blocksworld)
  (:requirements :strips)
  (:predicates (on ?above ?below) (on-table ?block) (clear ?block) (arm-empty) (holding ?block))

  (:action pick-up
    :parameters (?block)
    :precondition (and (clear ?block) (on-table ?block) (arm-empty))
    :effect (and (holding ?block)
                 (not (on-table ?block)) (not (clear ?block)) (not (arm-empty))))

  (:action put-down
    :parameters (?block)
    :precondition (and (holding ?block))
    :effect (and (on-table ?block) (clear ?block) (arm-empty) (not (holding ?block))))

  (:action stack
    :parameters (?above ?below)
    :precondition (and (holding ?above) (clear ?below))
    :effect (and (on ?above ?below) (clear ?above) (arm-empty)
                 (not (holding ?above)) (not (clear ?below))))

  (:action unstack
    :parameters (?above ?below)
    :precondition (and (on ?above ?below) (clear ?above) (arm-empty))
    :effect (and (holding ?above) (clear ?below)
                 (not (on ?above ?below)) (not (clear ?above)) (not (arm-empty)))))
