"""Machines that exist, in plain matrix products: what the core computes is computed here apart."""
