"""The model of colours fitted to samples of slope and colour, whatever pressed the gel."""
