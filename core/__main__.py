"""Entry of the worker process: ``python core/__main__.py`` with one JSON request on stdin. See `worker`."""

import sys

if __name__ == "__main__":
    # Started as a file, Python has put core/ first on the path.
    import bootstrap

    bootstrap.load()
    from cvdgs.core.worker import main

    sys.exit(main())
