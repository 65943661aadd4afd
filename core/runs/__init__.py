"""A finished run on disk: its folder, the layout of its names, its report. Standard library only."""
