"""A synthetic vehicle: truth, what its sensors say, what breaks, and the MAVLink that follows."""
