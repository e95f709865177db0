; Blocks, for one or two objects.
(define (domain blocks)
  (:requirements :adl)
  (:predicates (clear ?x) (on ?x ?y) (done))
  (:action move
    :parameters (?what ?from ?to)
    :precondition (and (clear ?what) (clear ?to) (on ?what ?from)
                       (or (done) (forall (?b) (clear ?b)) (exists (?b) (not (clear ?b)))))
    :effect (and (not (clear ?to)) (on ?what ?to) (clear ?from) (done))))
