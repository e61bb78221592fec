"""What every test file may ask for: `joined` and `master` (a file brings its own `plumb`)."""

from master import joined, master

__all__ = ["joined", "master"]
