"""A calibration in the words of controllers and robots: one file for each kind."""
