"""``python -m qparm.compiled``: compile all kernels ahead of the first run, as when an image is built."""

import sys

from qparm.compiled.beside import compile_all

if __name__ == "__main__":
    sys.exit(0 if compile_all() else 1)
