"""Entry of the worker process: ``python core/__main__.py`` with one JSON request on stdin. See `worker`."""

import os
import sys

if __name__ == "__main__":
    # Started as a file, Python has put core/ first on the path.
    import bootstrap

    bootstrap.load()
    from cvdgs.core.worker import main

    code = main()
    sys.stdout.flush()
    sys.stderr.flush()
    # Not sys.exit: libraries in C++ may crash while they are taken down, when the result has been told already.
    os._exit(code)
