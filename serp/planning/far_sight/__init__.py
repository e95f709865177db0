"""Planning that sees to the end of a task: closed planning graphs, exact and over cells."""
