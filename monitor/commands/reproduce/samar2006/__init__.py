"""samar2006: damage of the wings, estimated from accelerations over a moving horizon."""
