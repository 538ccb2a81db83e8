"""The paper's tables, ours beside them: what is run, what it comes to, and how it is shown."""
