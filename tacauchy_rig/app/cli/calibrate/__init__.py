"""``tacauchy-rig calibrate``: a command a module."""
