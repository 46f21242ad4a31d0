"""``python -m truearm``: the same as the command ``truearm``."""

from truearm.command_line import run

if __name__ == "__main__":
    run()
