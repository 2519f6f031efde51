"""``python -m physretarget``: the program, where its script is not on the path."""

from physretarget.cli import main

if __name__ == "__main__":
    main()
