"""The parts of a calibration: the board, its pictures, how the pairs fit together."""
