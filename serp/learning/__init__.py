"""The learner: a DQN for small dense networks on one CPU core (paper, section 3.3).

`dqn` combines the parts: it proposes actions, stores env steps (`replay`) and
learns from them (`learning`, which minimises the `loss` of a `network`). Nothing is imported here,
so that torch is loaded only for learning.
"""
