"""Blind trials: devices with effects nobody declared, by mathematics the core does not share."""
