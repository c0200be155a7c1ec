"""Two cameras in, a textured metric 3-D model out, on any GPU or none."""
