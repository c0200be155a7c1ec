"""The parts of a calibration: both cameras fitted to the pairs of a board, and what can be said of the fit."""
