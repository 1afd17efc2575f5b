"""Results as a person holds them: a calibration, a trace, a certificate."""
