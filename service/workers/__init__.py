"""What a worker does: attempts at jobs, each task of one in a process of its own."""
