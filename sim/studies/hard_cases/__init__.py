"""What a solver may break on, each with a criterion and the numbers that were measured."""
