"""The processes of a run: control, camera and recorder, started and watched by the supervisor."""
