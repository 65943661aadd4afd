"""Training data without downloads: procedural images, plates, and pairs of images and their recolouring."""
