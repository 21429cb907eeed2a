"""Arrays in, arrays and a status out: estimators and detectors without I/O, clocks or logging."""
