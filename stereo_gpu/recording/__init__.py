"""The parts of a capture: sources of pictures, how they are paired, judged and written."""
