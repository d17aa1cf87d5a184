"""Names that the command line offers, apart from what they bring."""

from enum import StrEnum

INDEX = "index.parquet"
"""Of a data set's folder, which it tells from others."""


class EngineName(StrEnum):
    """What ``--engine`` takes."""

    LOCAL = "local"
    GPU = "gpu"
    DASK = "dask"
    FOLDER = "folder"
