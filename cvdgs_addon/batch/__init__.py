"""What Blender does for a batch of turntables: frames, videos and contact sheets, each in a process of its own."""
