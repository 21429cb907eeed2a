"""What ``mavsentry bench against`` does: our verdicts beside those of the autopilots' own checks.

========  ==========================================================================
judges    who judges a flight, and what each says of it as verdicts of one form
score     verdicts against the faults that are known: delays, missed, false
tables    the outcome as Markdown, as rows for the terminal and as JSON
command   what is typed
========  ==========================================================================
"""
