"""Tamper with copies of a run in every way that was thought of, and write down what is noticed."""
