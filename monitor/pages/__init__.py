"""What all pages share: colours, type, theme, charts, and a policy that lets nothing in.

The report, the live page and the fleet page are built on this. Nothing here knows a flight.
"""
