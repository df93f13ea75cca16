"""``python -m qparm.cli``."""

from qparm.cli import main

if __name__ == "__main__":
    main()
