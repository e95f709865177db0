"""Planning with the transition model: lookahead, planning graph, monitor-replanning (MrP)."""
