"""What a worker does with a job, each in its own folder."""
