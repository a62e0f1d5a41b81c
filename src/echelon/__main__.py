"""``python -m echelon`` is the command line."""

from echelon.cli import main

if __name__ == "__main__":
    main()
