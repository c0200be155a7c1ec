"""The parts of reconstructing many pairs: which they are, and the processes that work on them."""
