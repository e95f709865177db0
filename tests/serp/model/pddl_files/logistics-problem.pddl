(define (problem one-parcel)
  (:domain logistics)
  (:objects parcel - package
            van lorry - truck
            jet - airplane
            north-depot south-depot - location
            north-field south-field - airport
            north south - city)
  (:init (in-city north-depot north) (in-city north-field north)
         (in-city south-depot south) (in-city south-field south)
         (at parcel north-depot) (at van north-field) (at lorry south-field)
         (at jet south-field))
  (:goal (and (at parcel south-depot))))
