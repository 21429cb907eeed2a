"""Bytes to samples and back: MAVLink, logs, endpoints, clocks. Imports none of the other rooms."""
