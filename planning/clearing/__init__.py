"""Taking objects off a cluttered table, one at a time, and dropping each into a bin."""
