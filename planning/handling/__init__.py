"""How a task is carried through, with looking again and recovery."""
