"""``mavsentry run``: what it puts together, and what happens around each turn of its loop."""
