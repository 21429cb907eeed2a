"""wan2018: Figs. 3 to 5, Theorem 1, and the 249 parametric runs of its Tables III and IV."""
