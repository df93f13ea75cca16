"""``python -m qparm``."""

from qparm.cli import main

if __name__ == "__main__":
    main()
