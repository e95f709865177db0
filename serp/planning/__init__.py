"""Planning with the transition model: planning graph, lookahead, monitor-replanning (MrP)."""
