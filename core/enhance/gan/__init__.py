"""The conditional GAN: a U-Net that recolours, a PatchGAN that judges, their losses, training and weights."""
