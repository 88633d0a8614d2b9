"""Messages and frames between the processes and the clients of the service."""
