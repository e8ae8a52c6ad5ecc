"""Command line by ``python -m porocore``."""

from porocore.cli import program

if __name__ == "__main__":
    program()
