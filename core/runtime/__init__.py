"""The worker as a process: protocol, supervisor, environment, resources, progress, command lines."""
