"""``metrics.csv`` and ``junit.xml``: the same numbers for spreadsheets and for CI."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as ET


def metrics_csv(summary: Mapping[str, Any]) -> str:
    """Return one line a trial with every scalar of ``summary.json``, empty where unknown.

    Nested names are joined by dots, such as ``floors.no_contact.ssim``.
    """
    rows = [_scalars(trial) for trial in summary["trials"]]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    text = io.StringIO()
    writer = csv.DictWriter(text, ["simulated", *columns], lineterminator="\n", restval="")
    writer.writeheader()
    for row in rows:
        writer.writerow({"simulated": summary["simulated"], **row})
    return text.getvalue()


def _scalars(value: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    found: dict[str, object] = {}
    for key, item in value.items():
        name = f"{prefix}{key}"
        if isinstance(item, Mapping):
            found |= _scalars(item, f"{name}.")
        elif not isinstance(item, list):
            found[name] = "" if item is None else item
    return found


def junit_xml(summary: Mapping[str, Any]) -> str:
    """Return a JUnit report with one case per trial and criterion."""
    cases = [(trial, c) for trial in summary["trials"] for c in trial["criteria"]]
    failures = sum(not criterion["passed"] for _, criterion in cases)
    name = f"tacauchy-rig {summary['provenance'].get('name', 'run')}"
    if summary["simulated"]:
        name += " (SIMULATED)"
    root = ET.Element(
        "testsuites", name=name, tests=str(len(cases)), failures=str(failures), errors="0"
    )
    suite = ET.SubElement(root, "testsuite", root.attrib)
    properties = ET.SubElement(suite, "properties")
    for key in ("simulated", "passed"):
        ET.SubElement(properties, "property", name=key, value=str(summary[key]).lower())
    for trial, criterion in cases:
        case = ET.SubElement(
            suite,
            "testcase",
            classname=f"trial-{trial['index']:02d}-{trial['force_target_n']:.4f}N",
            name=criterion["name"],
        )
        if not criterion["passed"]:
            message = f"{_measured(criterion)}; limit: {criterion['limit']}"
            failure = ET.SubElement(case, "failure", message=message, type="criterion")
            failure.text = criterion["remedy"]
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _measured(criterion: Mapping[str, Any]) -> str:
    if criterion["measured"] is None:
        return "not measured"
    return f"measured {criterion['measured']:.6g} {criterion['unit']}".rstrip()
