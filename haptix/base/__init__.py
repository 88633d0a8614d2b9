"""What every room stands on: checks, documents, errors, files, tasks, inner loops in C; no physics in Python."""
