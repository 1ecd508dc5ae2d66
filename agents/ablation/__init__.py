"""Compares rewards: trains each on the same texts with the same seeds, measures what they learned, reports it."""
