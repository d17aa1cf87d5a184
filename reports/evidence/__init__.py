"""From a run folder to the evidence of a report."""
