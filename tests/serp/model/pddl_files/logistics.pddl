; Parcels travel by truck within a city and by aeroplane between airports.
(define (domain logistics)
  (:requirements :strips :typing)
  (:types truck airplane - vehicle
          package vehicle - thing
          airport location - place
          city)
  (:predicates (in-city ?where - place ?city - city)
               (at ?what - thing ?where - place)
               (in ?package - package ?vehicle - vehicle))

  (:action load-truck
    :parameters (?package - package ?truck - truck ?where - place)
    :precondition (and (at ?truck ?where) (at ?package ?where))
    :effect (and (not (at ?package ?where)) (in ?package ?truck)))

  (:action load-airplane
    :parameters (?package - package ?airplane - airplane ?where - airport)
    :precondition (and (at ?package ?where) (at ?airplane ?where))
    :effect (and (not (at ?package ?where)) (in ?package ?airplane)))

  (:action unload-truck
    :parameters (?package - package ?truck - truck ?where - place)
    :precondition (and (at ?truck ?where) (in ?package ?truck))
    :effect (and (not (in ?package ?truck)) (at ?package ?where)))

  (:action unload-airplane
    :parameters (?package - package ?airplane - airplane ?where - airport)
    :precondition (and (in ?package ?airplane) (at ?airplane ?where))
    :effect (and (not (in ?package ?airplane)) (at ?package ?where)))

  (:action drive-truck
    :parameters (?truck - truck ?from ?to - place ?city - city)
    :precondition (and (at ?truck ?from) (in-city ?from ?city) (in-city ?to ?city))
    :effect (and (not (at ?truck ?from)) (at ?truck ?to)))

  (:action fly-airplane
    :parameters (?airplane - airplane ?from ?to - airport)
    :precondition (and (at ?airplane ?from))
    :effect (and (not (at ?airplane ?from)) (at ?airplane ?to))))
