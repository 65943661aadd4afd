"""Trainings measured: the time of a step, time to a quality, what is decided automatically, strategies and seeds."""
