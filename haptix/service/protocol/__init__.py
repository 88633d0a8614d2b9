"""What the processes and clients of the service say to each other."""
