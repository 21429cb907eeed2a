"""lu2016: faults of an IMU reconstructed by kinematic models, in wind and on recorded flights."""
