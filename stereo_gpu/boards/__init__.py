"""Boards: what they are, how they are printed and found in pictures, and what the views of one cover."""
