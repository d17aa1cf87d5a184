"""Names that the command line offers, apart from what they bring."""

from enum import StrEnum


class Format(StrEnum):
    """What can be written."""

    CSV = "csv"
    LEROBOT = "lerobot"
    HDF5 = "hdf5"
    ROSBAG2 = "rosbag2"
    WEBDATASET = "webdataset"
    VTU = "vtu"
    USD = "usd"
    ISAACLAB = "isaaclab"
    TAXIM = "taxim"
    TACEX = "tacex"
    PRESSURE_LAW = "pressure-law"
