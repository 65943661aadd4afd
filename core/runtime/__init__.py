"""The worker as a process: protocol, supervisor, environment, resources, threads, progress, command lines."""
