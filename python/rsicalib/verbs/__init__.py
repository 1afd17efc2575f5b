"""What is done with readings and results: calibrate, trace, watch, certify, export."""
