"""The figures of the calibration report, a module each, drawn as SVG."""
