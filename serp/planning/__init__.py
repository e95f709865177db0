"""Planning with the transition model: lookahead, closed graph, cells, search for a goal."""
