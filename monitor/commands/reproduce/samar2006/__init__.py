"""samar2006: faults of the wings of an Aerosonde, estimated by a monotone moving horizon."""
