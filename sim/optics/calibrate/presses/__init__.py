"""Ball presses: their images, their gel profiles, and what is wrong with them."""
