"""Where methods fail: one condition at a time made worse, from harmless to broken, and several methods side by side."""
