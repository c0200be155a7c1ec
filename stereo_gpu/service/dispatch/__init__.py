"""From the table to the workers and back."""
