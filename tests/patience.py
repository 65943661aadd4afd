"""How long tests wait for what ought to happen at once: stand-ins for long work last longer than this."""

SOON = 30.0  # seconds, for a machine that is busy with other things; on an idle one it is a second
