"""For all tests: threads that wait without spinning, which has to be said before torch is imported."""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
