"""The contact modes of the paper's figures: press, slide, twist."""
