"""Fleets of devices of one design, with a known error of the drawing."""
