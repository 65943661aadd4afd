"""What a run and a batch both render with Blender: requests, frames, turntables."""
