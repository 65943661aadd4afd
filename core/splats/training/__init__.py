"""Fitting Gaussians to photographs: the trainer, its plan and decisions, colour layers."""
