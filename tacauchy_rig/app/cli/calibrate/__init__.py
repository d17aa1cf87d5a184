"""``tacauchy-rig calibrate``: one module for each command."""
