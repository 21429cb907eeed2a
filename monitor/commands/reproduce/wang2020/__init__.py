"""Wang et al. (2020): speeds of a two-spool engine from channels that fail at any moment."""
