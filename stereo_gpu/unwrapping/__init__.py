"""The parts of unwrapping: charts, their packing, and the processes in which xatlas runs."""
