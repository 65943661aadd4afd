"""Comparisons of enhancers on photographs, plates and textiles, with controls."""
