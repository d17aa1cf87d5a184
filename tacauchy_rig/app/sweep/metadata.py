"""Metadata of a data set: plan, checksums, Croissant and RO-Crate."""

import datetime
import json
from importlib import resources
from pathlib import Path
from typing import Any

from tacauchy_rig.app.sweep.engine_names import INDEX
from tacauchy_rig.app.sweep.plan import Plan, made_with
from tacauchy_rig.app.sweep.shards import LARGE, SHARDS
from tacauchy_rig.core.store.atomic_write import write_atomically
from tacauchy_rig.core.store.run_files import file_sha256
from tacauchy_rig.core.versions import library

_CROISSANT = "http://mlcommons.org/croissant/1.1"
PLAN, SUMS = "plan.json", "SHA256SUMS"
_LISTS: tuple[str, ...] = ("data_collection_type", "data_preprocessing_protocol", "data_biases")
_LISTS += ("data_limitations", "data_use_cases", "personal_sensitive_information")
_TYPES = {"string": "TEXT", "double": "FLOAT", "bool": "BOOL", "int64": "INTEGER"}


def write_datasheet(folder: Path, plan: Plan, table: Any) -> None:
    """Write ``plan.json``, ``SHA256SUMS``, ``croissant.json`` and ``ro-crate-metadata.json``.

    Raises:
        ConfigError: mlcroissant or rocrate is not installed.
    """
    write_atomically(folder / PLAN, plan.model_dump_json(indent=2).encode())
    names = (PLAN, INDEX, *sorted(set(table["shard"].to_pylist())))
    sums = {name: file_sha256(folder / name, what="a file of the data set") for name in names}
    lines = "".join(f"{digest}  {name}\n" for name, digest in sums.items())
    write_atomically(folder / SUMS, lines.encode())
    facts = _facts(plan, table)
    write_atomically(folder / "croissant.json", _json(_croissant(plan, table, sums, facts)))
    _write_crate(folder, plan, sums, facts)


def _json(content: Any) -> bytes:
    return (json.dumps(content, indent=2, default=str) + "\n").encode()


def _facts(plan: Plan, table: Any) -> dict[str, str]:
    """Return the sentences of the datasheet by their names."""
    text = resources.files(__package__).joinpath("datasheet.json").read_text("utf-8")
    valid = sum(table["valid"].to_pylist())
    given = {
        "count": str(table.num_rows),
        "invalid": str(table.num_rows - valid),
        "edge": f"{plan.simulation.edge * 1e3:g} mm",
        "design": str(plan.design),
        "seed": str(plan.seed),
        "sensors": ", ".join(sorted(set(table["sensor"].to_pylist()))),
        "versions": ", ".join(f"{name} {version}" for name, version in made_with().items()),
    }
    return {name: value.format(**given) for name, value in json.loads(text).items()}


def _croissant(plan: Plan, table: Any, sums: dict[str, str], facts: dict[str, str]) -> Any:
    mlc = library("mlcroissant", extra="sweep")
    kind = "application/x-parquet"
    files = [
        mlc.FileObject(id=name, name=name, content_url=name, encoding_formats=[kind], sha256=digest)
        for name, digest in sums.items()
        if name.endswith(".parquet")
    ]
    shards = mlc.FileSet(
        id=SHARDS, name=SHARDS, includes=[f"{SHARDS}/*.parquet"], encoding_formats=[kind]
    )

    def records(name: str, kinds: dict[str, str], **where: str) -> Any:
        columns = [
            mlc.Field(
                id=f"{name}/{column}",
                name=column,
                data_types=[getattr(mlc.DataType, kind)],
                source=mlc.Source(**where, extract=mlc.Extract(column=column)),
            )
            for column, kind in kinds.items()
        ]
        return mlc.RecordSet(id=name, name=name, fields=columns)

    typed = {field.name: str(field.type) for field in table.schema}
    small = {name: _TYPES[kind] for name, kind in typed.items() if kind in _TYPES}
    large = {name: "TEXT" if name in LARGE[2:] else "IMAGE_OBJECT" for name in LARGE}
    given = {name: [value] if name in _LISTS else value for name, value in facts.items()}
    return mlc.Metadata(
        name=plan.dataset.name,
        conforms_to=[_CROISSANT, f"{_CROISSANT.rpartition('/')[0]}/RAI/1.0"],
        license=[plan.dataset.licence],
        creators=[mlc.Person(name=plan.dataset.creator)] if plan.dataset.creator else [],
        date_published=_today(),
        distribution=[*files, shards],
        record_sets=[
            records("presses", small, file_object=INDEX),
            records("fields", large, file_set=SHARDS),
        ],
        **given,
    ).to_json()


def _write_crate(folder: Path, plan: Plan, sums: dict[str, str], facts: dict[str, str]) -> None:
    model = library("rocrate.model", extra="sweep")
    crate = library("rocrate.rocrate", extra="sweep").ROCrate()
    crate.name, crate.description = plan.dataset.name, facts["description"]
    crate.license, crate.datePublished = plan.dataset.licence, _today()
    if plan.dataset.creator:
        crate.creator = crate.add(
            model.Person(crate, "#creator", properties={"name": plan.dataset.creator})
        )
    for name, digest in sums.items():
        crate.add(model.File(crate, folder / name, name, properties={"sha256": digest}))
    write_atomically(folder / "ro-crate-metadata.json", _json(crate.metadata.generate()))


def _today() -> datetime.datetime:
    return datetime.datetime.combine(datetime.datetime.now(datetime.UTC).date(), datetime.time())
