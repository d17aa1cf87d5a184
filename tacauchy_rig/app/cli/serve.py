"""``tacauchy-rig serve``: a page of runs, for a browser on this machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tacauchy_rig.app.cli.output import say


def serve(
    folder: Annotated[
        Path, typer.Argument(metavar="RUNS", help="Folder of runs, or one run.")
    ] = Path("runs"),
    port: Annotated[int, typer.Option(min=0, help="0 takes a free one.")] = 0,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in a browser.")] = False,
) -> None:
    """Serve a page of runs: verdicts, reports, two beside each other, a sensor's health.

    It changes nothing, and is reached from this machine alone, by the address that is printed.

    Example: tacauchy-rig serve runs --open
    """
    import secrets

    import uvicorn

    from protocols.processes.page.access import AccessRule
    from protocols.processes.viewing import listen
    from tacauchy_rig.app.cli.watching import open_in_browser
    from tacauchy_rig.app.results.runs import folder_of_runs
    from tacauchy_rig.app.results.server import ResultsServer

    root, only = folder_of_runs(folder)
    with listen(port, option="--port") as taken:
        number = taken.getsockname()[1]
        access = AccessRule(secrets.token_urlsafe(16), port=number)
        address = f"http://127.0.0.1:{number}/{access.token}/"
        say(f"runs of {root} at {address} (Ctrl-C ends)")
        if open_:
            open_in_browser(address)
        app = ResultsServer(root, access, only=only).app
        config = uvicorn.Config(
            app, http="h11", ws="none", lifespan="off", log_level="warning", server_header=False
        )
        uvicorn.Server(config).run(sockets=[taken])
