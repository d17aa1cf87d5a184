"""The simulator against solutions and measurements that it did not make."""

from functools import partial

from tacauchy_rig.core.page import table_prose

stated = partial(table_prose, "sim.studies.verification", "tables.md.jinja")
"""What is said of a table: title, criterion and note."""
