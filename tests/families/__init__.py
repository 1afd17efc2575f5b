"""Blind trials on machines unlike the hand controller, by mathematics the core does not share."""
