"""One run, from a capture folder to a finished run: launch, stages, resume, preview."""
