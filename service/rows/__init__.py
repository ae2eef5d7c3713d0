"""What the database holds: rows of jobs, uploads, cameras, keys and workers, and their rules."""
