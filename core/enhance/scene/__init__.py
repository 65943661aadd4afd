"""The scene network: a table of colours and a small network that sees each pixel's surroundings, fitted to a scene."""
