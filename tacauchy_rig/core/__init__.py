"""What every package uses: errors, units, configuration, records of runs, and their storage."""
