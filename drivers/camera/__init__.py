"""Tactile camera: UVC, or an MJPEG stream, through OpenCV."""
