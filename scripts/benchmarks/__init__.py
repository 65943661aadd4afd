"""The parts of scripts/benchmark.py: measurements of the product for researchers, not shipped with the extension."""
