"""What a run measures: the figures of its report, and the warnings that follow from them."""
