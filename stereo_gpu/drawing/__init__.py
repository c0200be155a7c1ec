"""The parts of drawing: where the camera stands, and which triangle each pixel shows."""
