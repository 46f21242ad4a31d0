"""``python -m truearm``: the same as the command ``truearm``."""

from truearm.cli.main import run

if __name__ == "__main__":
    run()
