"""What stops the arm: limits on force, depth, streams, place, following, and people.

A check raises ``BreachError``, which names the limit, what was measured and the reaction.
"""
