"""The parts of scripts/benchmark.py, one module each: what a part is asked for, and the call that measures it."""
