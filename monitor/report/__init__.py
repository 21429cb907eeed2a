"""The report of one flight: one HTML file that loads nothing."""
