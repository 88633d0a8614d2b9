"""What every room stands on: checks, documents, errors, files, tasks, loops in C; no physics."""
