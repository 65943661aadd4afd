"""The job of scripts/enhance.py: photographs alone, recoloured. `front` runs anywhere, the rest in the worker."""
