"""Training the conditional GAN: losses, batches, checkpoints. Not shipped with the extension."""
