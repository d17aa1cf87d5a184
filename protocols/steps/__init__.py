"""The steps of a trial, from home to home.

Each ends early with the ``BreachError`` or ``AbortedError`` of the cycle that it turns.
"""
