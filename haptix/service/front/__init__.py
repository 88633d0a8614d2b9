"""The process that serves HTTP and sockets, without torch."""
