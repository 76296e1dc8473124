"""The methods by which loads are proved: names only, so that the command line can offer them without loading any."""

METHODS = ("ends", "bernstein", "sturm", "enclosure", "sos", "sampled")
