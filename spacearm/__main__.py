"""python -m spacearm."""

from spacearm.cli import main

if __name__ == "__main__":
    main()
