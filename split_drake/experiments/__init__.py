"""How runs are done: worker processes, run folders, provenance, statistics."""
