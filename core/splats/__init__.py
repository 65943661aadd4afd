"""Gaussian splatting: the model, its file format, the rasteriser and the trainer."""
