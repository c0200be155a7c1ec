"""Uploads as they come: streamed, counted, looked at, and nothing left of those that fail."""
