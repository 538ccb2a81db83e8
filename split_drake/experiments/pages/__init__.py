"""Pages of runs for the browser, which need no server: what was run, and what became of it."""
