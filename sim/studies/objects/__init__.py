"""Five objects pressed into sensors."""
