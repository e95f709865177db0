"""The learner: a DQN for small dense networks on one CPU core (paper, section 3.3)."""
