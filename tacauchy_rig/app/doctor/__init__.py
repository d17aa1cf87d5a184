"""Is this computer fit for a run? Each check tells what was measured and what to do."""
