"""From sample batches to verdicts: pipeline, watches, daemon, log analysis, command line."""
