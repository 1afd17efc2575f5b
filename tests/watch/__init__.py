"""Watches over simulated devices at work: run length, delay, and what was named."""
