"""wan2016: the eight scenarios of its Table 1, healthy and faulty, in the form of its Table 2."""
