"""The command line as `python -m eomcheck`."""

from eomcheck.cli import main

if __name__ == "__main__":
    main()
