"""The conditional GAN that predicts scene networks: a U-Net generator, its conditioning, its weights.

The discriminator, the losses and the training are in `scripts.training.gan`.
"""
