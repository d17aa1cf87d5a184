"""Names that the command line offers, apart from what they bring."""

from enum import StrEnum


class EngineName(StrEnum):
    """What ``--engine`` takes."""

    LOCAL = "local"
    GPU = "gpu"
    DASK = "dask"
    FOLDER = "folder"
