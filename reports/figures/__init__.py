"""Figures of the report, one kind a file; vector PDF and PNG at IEEE column widths."""
