"""Studies: what the product does to captures, in many ways side by side, as tables, charts and pages."""
