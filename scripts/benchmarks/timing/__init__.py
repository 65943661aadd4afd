"""Time and memory of training, batches, stills and files."""
