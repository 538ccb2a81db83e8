"""Runs on many machines, by Dask's distributed scheduler: `--scheduler tcp://host:8786`.

A Dask worker keeps a process for each of its threads, in which items are worked on as in
`experiments.pool`: one that crashes or takes too long costs its item alone.  Workers need the same
code and packages, and nothing else: files that items name are sent to them, and what items write
comes back with their results.
"""
