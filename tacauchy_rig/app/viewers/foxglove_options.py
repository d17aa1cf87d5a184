"""Whether a run is shown to Foxglove, Lichtblick or PlotJuggler, and where."""

from importlib.util import find_spec

from protocols.processes.child_process import LOOPBACK, listen
from protocols.processes.ipc import ViewerOptions
from tacauchy_rig.core.errors import ConfigError

NAME, MODULE, PORT = "foxglove", "tacauchy_rig.app.viewers.foxglove_publisher", "port"
PACKAGE = "foxglove"
OPTION = "--foxglove"
SOURCES = ("twin",)


def viewer_options(port: int) -> ViewerOptions:
    """Return what the supervisor starts."""
    if find_spec(PACKAGE) is None:
        raise ConfigError(
            f"{OPTION}: the package foxglove-sdk is not installed",
            remedy="pip install 'tacauchy-rig[foxglove]', or leave the option out",
        )
    listen(port, option=OPTION).close()
    return ViewerOptions(name=NAME, module=MODULE, options={PORT: str(port)}, sources=SOURCES)


def address(port: int) -> str:
    """Return what a viewer is to be connected to."""
    return f"ws://{LOOPBACK}:{port}"
