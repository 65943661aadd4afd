"""What touches the disk: untrusted input, atomic writes, images, PLY tables, tensors."""
