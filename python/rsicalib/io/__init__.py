"""Files in and out: readings, mechanisms, robot descriptions."""
