"""The stress test: one condition at a time is made worse, from harmless to severe, for several methods."""
