"""Everything that learns: the low-level controller, the bundled encoder, text skills, and the command line.

Importing this package loads nothing heavy; torch and Stable-Baselines3 load with the module that trains.
"""
