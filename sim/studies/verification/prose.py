"""What is said of the tables of verification: title, criterion and note."""

from __future__ import annotations

from functools import partial

from tacauchy_rig.core.page import table_prose

stated = partial(table_prose, "sim.studies.verification", "tables.md.jinja")
