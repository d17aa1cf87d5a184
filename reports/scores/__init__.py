"""Scores of images and forces, with their floors."""
