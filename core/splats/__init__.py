"""Gaussian splatting: the model, its file formats, the rasteriser and the trainer."""
