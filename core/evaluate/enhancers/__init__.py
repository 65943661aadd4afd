"""Enhancers compared on photographs, plates and textiles, beside honest controls."""
