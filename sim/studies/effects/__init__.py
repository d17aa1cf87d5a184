"""Plans of effects held against everything switched on."""
