"""What every room stands on: checks, documents, errors, files, tasks; no physics."""
