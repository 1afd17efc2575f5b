"""Where a mechanism is: under a calibration, simulated, or from a pose back to readings."""
