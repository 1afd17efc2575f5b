"""Logs of other programs as readings: one file for each format, one way in (`opening`)."""
