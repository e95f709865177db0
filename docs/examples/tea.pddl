; A tea robot: it heats water and pours it into cups. Degrees Celsius, litres, seconds.
(define (domain tea)
  (:requirements :strips :typing :negative-preconditions :universal-preconditions
                 :conditional-effects :numeric-fluents :time)
  (:types cup)

  ; What is true or false.
  (:predicates
    (heater-on)
    (filled ?c - cup)
    (unsafe)
    (terminal))

  ; What has a number.
  (:functions
    (temperature)    ; of the water in the kettle
    (water)          ; in the kettle
    (size ?c - cup)  ; what a cup holds
    (reward))

  ; What the robot can do.

  (:action switch-on  ; the heater
    :parameters ()
    :precondition (and (not (heater-on)))
    :effect (and (heater-on)))

  (:action switch-off
    :parameters ()
    :precondition (and (heater-on))
    :effect (and (not (heater-on))))

  (:action pour
    :parameters (?c - cup)
    :precondition (and (not (filled ?c)) (>= (water) (size ?c)))
    :effect (and
      (filled ?c)
      (decrease (water) (size ?c))
      (when (>= (temperature) 90.0) (increase (reward) 10.0))
      (when (< (temperature) 90.0) (decrease (reward) 10.0))))

  (:action wait
    :parameters ()
    :precondition (and)
    :effect (and))

  ; What the world does by itself, all the time.

  (:process heating  ; a degree a second
    :parameters ()
    :precondition (and (heater-on))
    :effect (and (increase (temperature) (* #t 1.0))))

  (:process cooling
    :parameters ()
    :precondition (and (> (temperature) 20.0))
    :effect (and (decrease (temperature) (* #t (* 0.002 (- (temperature) 20.0))))))

  ; What happens at certain points.

  (:event boiling  ; water becomes steam
    :parameters ()
    :precondition (and (> (temperature) 100.0))
    :effect (and (assign (temperature) 100.0) (decrease (water) 0.01)))

  ; Every step costs the more, the colder the water is: a way to the good that shows at once.
  (:event not-hot-yet
    :parameters ()
    :precondition (and (< (temperature) 90.0))
    :effect (and (decrease (reward) (* 0.01 (- 90.0 (temperature))))))

  (:event dry  ; the kettle burns
    :parameters ()
    :precondition (and (heater-on) (< (water) 0.1))
    :effect (and (unsafe)))

  (:event served
    :parameters ()
    :precondition (and (forall (?c - cup) (filled ?c)))
    :effect (and (terminal))))
