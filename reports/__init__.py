"""Metrics, floors, figures and the report."""
