"""One module for each kind of file that `softprint inspect` knows."""
