"""Batches of turntables: a batch file becomes a plan, a plan is a list of tasks, a task is one command line.

Standard library only, except the modules that make pictures and those that speak to another engine: any Python,
Blender's included, reads a batch, plans it and runs it on one machine; workers and Blender do the heavy part.
"""
