"""The learner: a DQN for small dense networks on one CPU core (paper, section 3.3).

`dqn` puts it together: it proposes actions (`exploration`), remembers env steps
(`replay`) and learns from them (`learning`, which minimises the `loss` of a `network`). Nothing is
imported here: torch is loaded only where something learns.
"""
