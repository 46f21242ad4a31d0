"""``python -m truearm``: the same as the command ``truearm``."""

from truearm.command_line import console

if __name__ == "__main__":
    console()
